"""From scans as given to cells ready for the fit (section 2.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from gmmtorch import PointClouds
from novelty.errors import InputError
from novelty.preprocess.crop import crop
from novelty.preprocess.feet import feet_of
from novelty.preprocess.ground import (
    NoGround,
    Plane,
    agree_on_ground,
    drop_ground,
    find_ground,
    follow_ground,
)
from novelty.preprocess.missing import drop_missing
from novelty.preprocess.outliers import drop_outliers
from novelty.preprocess.prepared import PreparedPairs, PreparedScans
from novelty.preprocess.settings import Preprocess
from novelty.preprocess.simplify import Scale, Simplified, simplify
from novelty.preprocess.spacing import Spacing, spacing_of
from novelty.preprocess.survivors import Survivors
from novelty.preprocess.units import doubt_of_metres, metres_per
from novelty.scan import Scan, ScanPair

ADVICE = {
    "not finite": "check the sensor driver or the export",
    "cropped": "widen min_range, max_range, min_height or max_height, or check `unit`",
    "outlier": "raise outlier_std_ratio or set outliers to none",
    "ground": "set ground to none to examine it",
}
"""What to change when a step takes the last points."""


@dataclass(frozen=True, eq=False)
class _Examined:
    """The points of one scan that are examined, all its returns and where the sensor met them, spacing and ground.

    `feet` (N,) are the points that stay though the ground holds them; None where none are known.
    """

    scan: Survivors
    returns: NDArray[np.float64]
    origins: NDArray[np.float64] | None
    spacing: Spacing
    ground: Plane | NoGround
    feet: NDArray[np.bool_] | None = None


def prepare_pairs(pairs: Sequence[ScanPair], settings: Preprocess, unit: str = "m") -> PreparedPairs:
    """Prepare both scans of every pair; the two scans of a pair agree on the ground.

    Args:
        pairs: P pairs.
        settings: What is taken out and how the rest is simplified.
        unit: Unit of the scans' coordinates: m, cm, mm, in or ft.

    Raises:
        InputError: There is no pair.
        ConfigError: The unit or the direction `up` is not valid.
    """
    scans = [pair.reference for pair in pairs] + [pair.current for pair in pairs]
    examined = _examined_scans(scans, settings, unit)
    middle = len(pairs)
    agreed = [_agreed(*both, settings) for both in zip(examined[:middle], examined[middle:], strict=True)]
    examined = [reference for reference, _ in agreed] + [current for _, current in agreed]
    prepared = _packed(scans, examined, settings)
    return PreparedPairs(
        reference=prepared.select(range(middle)), current=prepared.select(range(middle, 2 * middle))
    )


def prepare(
    scans: Sequence[Scan],
    settings: Preprocess,
    unit: str = "m",
    known_grounds: Sequence[Plane | NoGround] | None = None,
) -> PreparedScans:
    """Take out what is not examined, and simplify the rest, of all scans at once.

    A scan's result does not depend on the others. A scan of which nothing is left stays in its place as an empty
    cloud, with a note.

    Args:
        scans: B scans.
        settings: What is taken out and how the rest is simplified.
        unit: Unit of the scans' coordinates: m, cm, mm, in or ft.
        known_grounds: For each scan, what is known of the ground from an earlier scan of the place, m: what that one
            kept is kept, and its plane serves where no other is found.

    Raises:
        InputError: There is no scan.
        ConfigError: The unit or the direction `up` is not valid.
    """
    examined = _examined_scans(scans, settings, unit)
    if known_grounds is not None:
        examined = [
            replace(part, ground=follow_ground(known, part.ground))
            for known, part in zip(known_grounds, examined, strict=True)
        ]
    return _packed(scans, examined, settings)


def _examined_scans(scans: Sequence[Scan], settings: Preprocess, unit: str) -> list[_Examined]:
    if not scans:
        raise InputError("expected at least one scan to prepare, got an empty list.")
    metres = metres_per(unit)
    examined = [_examined(Survivors.from_scan(scan, metres), settings) for scan in scans]
    return [_doubted(part) for part in examined] if unit == "m" else examined


def _examined(scan: Survivors, settings: Preprocess) -> _Examined:
    # Missing returns.
    scan = drop_missing(scan)
    returns, origins = scan.points, scan.point_origins
    # Range from the sensor, band of heights.
    scan = crop(scan, settings)
    # Sparse outliers (Rusu et al. 2008).
    scan = drop_outliers(scan, settings)
    # Ground plane (Lai & Fox 2009); it is taken out once it is known whether another scan agrees.
    spacing = spacing_of(scan.points)
    return _Examined(scan, returns, origins, spacing, find_ground(scan, settings, spacing))


def _doubted(examined: _Examined) -> _Examined:
    """With a note where metres are hardly the unit."""
    note = doubt_of_metres(examined.scan.points, examined.spacing.distance)
    return examined if note is None else replace(examined, scan=examined.scan.noted(note))


def _agreed(reference: _Examined, current: _Examined, settings: Preprocess) -> tuple[_Examined, _Examined]:
    grounds = agree_on_ground((reference.ground, current.ground), (reference.scan, current.scan))
    if settings.feet and isinstance(grounds[0], Plane) and isinstance(grounds[1], Plane):
        one, other = reference.scan.points, current.scan.points
        reference = replace(reference, feet=feet_of(one, grounds[0], other, grounds[1]))
        current = replace(current, feet=feet_of(other, grounds[1], one, grounds[0]))
    return replace(reference, ground=grounds[0]), replace(current, ground=grounds[1])


def _without_ground(examined: _Examined) -> _Examined:
    left = drop_ground(examined.scan, examined.ground, examined.feet)
    spacing = spacing_of(left.points) if len(left) < len(examined.scan) else examined.spacing
    return replace(examined, scan=_explained(left), spacing=spacing)


def _packed(scans: Sequence[Scan], examined: Sequence[_Examined], settings: Preprocess) -> PreparedScans:
    examined = [_without_ground(part) for part in examined]
    points = PointClouds.from_list([part.scan.points for part in examined])
    simplified = _simplified(points, settings)
    return PreparedScans(
        cells=simplified.cells,
        points=points,
        cell_of_point=simplified.cell_of_point,
        kept=tuple(part.scan.kept for part in examined),
        num_given=tuple(scan.num_points for scan in scans),
        origins=tuple(part.origins for part in examined),
        returns=tuple(part.returns for part in examined),
        dropped=tuple(part.scan.dropped for part in examined),
        spacing=torch.tensor([part.spacing.distance for part in examined], dtype=torch.float64),
        cell_size=_typical_extent(points, simplified),
        notes=tuple(part.scan.notes for part in examined),
        grounds=tuple(part.ground for part in examined),
    )


def _explained(scan: Survivors) -> Survivors:
    """Say which step took the last points, if nothing is left."""
    if len(scan) or not any(scan.dropped.values()):
        return scan
    step = [name for name, count in scan.dropped.items() if count][-1]
    return scan.noted(
        f"Nothing is left to examine; the last {scan.dropped[step]} points went as {step!r}: {ADVICE[step]}."
    )


def _simplified(points: PointClouds, settings: Preprocess) -> Simplified:
    if settings.simplify == "none":
        return Simplified(cells=points, cell_of_point=torch.arange(len(points.points)))
    return simplify(points, Scale(settings.simplify, settings.max_cell_size, settings.max_surface_variation))


def _typical_extent(points: PointClouds, simplified: Simplified) -> torch.Tensor:
    """Median over a cloud's points of the RMS distance between a cell's points and their mean, (B,)."""
    if simplified.cells.spreads is None:
        return torch.tensor([0.0 if size else torch.nan for size in points.sizes], dtype=torch.float64)
    variances = simplified.cells.spreads.diagonal(dim1=1, dim2=2).sum(-1)[simplified.cell_of_point]  # (N,)
    medians = [part.median() if len(part) else part.new_tensor(torch.nan) for part in points.split(variances)]
    return torch.stack(medians).clamp_min(0).sqrt()
