"""A map kept up to date: what is new is taken in, what has gone is forgotten, what is out of sight stays.

The surfaces that map and scan share are in the map once. Where the scan measured them more densely its cells take
the place of the map's; elsewhere the map keeps its own, so that a map does not grow from scan to scan, and a thing
that is shifted by less than can be noticed is found in the end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import gmmtorch
from gmmtorch import FitResult, MixtureModel, PointClouds
from novelty.config import Config
from novelty.errors import InputError
from novelty.fitting import fitted_clouds
from novelty.maps.compare import compare, most_common
from novelty.maps.scene_map import SceneMap
from novelty.maps.views import View, renewed_views
from novelty.preprocess import PreparedScans
from novelty.registration import RegistrationStatus
from novelty.result import NoveltyResult, PointState
from novelty.scan import Scan
from novelty.visibility import Rays

DENSER = 0.7
"""The scan's cells replace the map's where they are smaller than this share of them."""

NEIGHBOURS = 16
"""Cells whose mean extent tells how densely a place was measured."""

FADED = 1e-6
"""What is left of the old evidence beside the cells: they are all the evidence, the old mixture only a start."""

MISFITS = (RegistrationStatus.LOW_OVERLAP, RegistrationStatus.NOT_CONVERGED, RegistrationStatus.FAR_AWAY)
"""What registration says of a scan of another place, or one whose pose is far off."""


@dataclass(frozen=True, eq=False)
class MapUpdate:
    """A map and what the scan did to it.

    Attributes:
        scene_map: The map as it is now.
        result: What the comparison of the scan with the old map found.
        cells_added: Cells of surfaces that the old map did not have.
        cells_refined: Cells of surfaces that the scan measured more densely.
        cells_forgotten: Cells of the old map that have gone.
        note: What a reader must know; empty when there is nothing to say.
    """

    scene_map: SceneMap
    result: NoveltyResult
    cells_added: int
    cells_refined: int
    cells_forgotten: int
    note: str = ""


def update(scene_map: SceneMap, scan: Scan, config: Config | None = None) -> MapUpdate:
    """Bring a map up to date with a new scan of the place; the map given stays as it is.

    Args:
        scene_map: The place as it was.
        scan: The place as it is now, in the frame and the unit of the map. Only with its origin known is anything
            forgotten: what has gone and what is out of sight look the same without.
        config: Settings of the comparison, as in `novelty.detect_against`.

    Raises:
        InputError: The scan has no answer or nothing to examine, its unit is not the map's, or it does not fit the map.
        ConfigError: The settings prepare scans otherwise than the map was made.
    """
    # Registration and comparison: what is new, what has gone.
    compared = compare(scene_map, scan, config)
    result = compared.result
    if not len(compared.current.points.points):
        raise InputError(
            f"{scan.name or 'the scan'} has no point left to examine, so the map {scene_map.name!r} was left as it is: "
            + " ".join(compared.current.notes[0])
        )
    current = compared.current.moved(_pose(scene_map, scan, result))
    stations = current.stations[0]
    # Which cells of either are in the new map.
    gone = result.removed.point_labels & bool(stations)
    found = most_common(result.added.point_states[current.kept[0]], current.cell_of_point.numpy())
    unknown = found != PointState.UNCHANGED
    replaced, refining = _denser(scene_map.cells, current.cells, ~gone, ~unknown)
    kept, taken = ~gone & ~replaced, unknown | refining
    renewed = _joined(scene_map, current, kept, taken)
    return MapUpdate(
        # The mixture refined with them, its order chosen anew (Algorithm 1).
        scene_map=replace(
            renewed,
            model=_refined(renewed),
            views=_views(scene_map, current, stations, result),
        ),
        result=result,
        cells_added=int(unknown.sum()),
        cells_refined=int(refining.sum()),
        cells_forgotten=int(gone.sum()),
        note=_note(result, bool(stations)),
    )


def _pose(scene_map: SceneMap, scan: Scan, result: NoveltyResult) -> torch.Tensor:
    """The motion that takes the scan into the frame of the map, (1, 4, 4)."""
    registration = result.registration
    assert registration is not None
    status = RegistrationStatus[registration["status"]]
    if status in MISFITS:
        raise InputError(
            f"{scan.name or 'the scan'} does not fit the map {scene_map.name!r}, which was left as it is: "
            f"{status.advice} (overlap {registration['overlap']:.0%})."
        )
    return torch.tensor(registration["transform"], dtype=torch.float64)[None]


def _denser(
    old: PointClouds, new: PointClouds, old_shared: NDArray[np.bool_], new_shared: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which old cells are measured more densely now, bool (M,), and which new cells take their place, bool (M',)."""
    replaced, refining = np.zeros_like(old_shared), np.zeros_like(new_shared)
    if not old_shared.any() or not new_shared.any():
        return replaced, refining
    old_rows, new_rows = np.flatnonzero(old_shared), np.flatnonzero(new_shared)
    old_tree, new_tree = (
        cKDTree(cells.points.numpy()[rows]) for cells, rows in ((old, old_rows), (new, new_rows))
    )
    before, now = _extents(old, old_rows, old_tree), _extents(new, new_rows, new_tree)
    apart, nearest = new_tree.query(old_tree.data)
    denser = (apart <= before) & (now[nearest] < DENSER * before)
    # A new cell is taken when the old cell it lies nearest to may go, which then goes only for such a new cell.
    lies_at = old_tree.query(new_tree.data)[1]
    denser &= denser[lies_at][nearest]
    taken = denser[lies_at]
    replaced[old_rows], refining[new_rows] = denser, taken
    return replaced, refining


def _extents(cells: PointClouds, rows: NDArray[np.int64], tree: cKDTree) -> NDArray[np.float64]:
    """Mean root-mean-square extent of the cells around each, m (M,)."""
    assert cells.spreads is not None
    own = cells.spreads.diagonal(dim1=1, dim2=2).sum(-1).clamp_min(0).sqrt().numpy()[rows]
    _, around = tree.query(tree.data, k=list(range(1, min(NEIGHBOURS, len(rows)) + 1)))
    means: NDArray[np.float64] = own[around].mean(axis=1)
    return means


def _joined(
    scene_map: SceneMap, current: PreparedScans, kept: NDArray[np.bool_], taken: NDArray[np.bool_]
) -> SceneMap:
    """The map of the old cells that are kept and the new ones that are taken, with its lengths; the old mixture."""
    old, new = _only(scene_map.cells, kept), _only(current.cells, taken)
    both = PointClouds.concatenate([old, new])
    assert both.spreads is not None
    cells = PointClouds(both.points, both.weights, both.spreads, (0, len(both.points)), both.dtype)
    share = float(new.total_weights / cells.total_weights)
    variances = both.spreads.diagonal(dim1=1, dim2=2).sum(-1).repeat_interleave(both.weights.long())
    return replace(
        scene_map,
        cells=cells,
        spacing=(1 - share) * scene_map.spacing + share * float(current.spacing[0]),
        cell_size=float(variances.median().clamp_min(0).sqrt()),
        num_scans=scene_map.num_scans + 1,
    )


def _refined(scene_map: SceneMap) -> FitResult:
    """The map's mixture with components merged, moved and added until it describes the cells there are now."""
    settings = scene_map.config.fit
    cells = fitted_clouds(scene_map.prepared(), settings)
    refined = gmmtorch.update(
        MixtureModel(scene_map.model.mixtures, cells),
        cells,
        forgetting=FADED,
        max_components=scene_map.config.max_components,
        seed=scene_map.config.seed,
        min_std=settings.min_std,
    )
    mixtures = refined.model.mixtures
    mdl = gmmtorch.description_length(mixtures, cells)
    orders = torch.arange(1, mixtures.num_slots + 1)
    return FitResult(
        mixtures=mixtures,
        mdl=mdl,
        mdl_path=torch.where(orders == mixtures.num_components[:, None], mdl[:, None], torch.nan),
        log_likelihood=(mixtures.log_prob(cells) * cells.weights).sum()[None],
        status=refined.status,
        num_iterations=refined.num_iterations,
    )


def _only(cells: PointClouds, chosen: NDArray[np.bool_]) -> PointClouds:
    """Some cells of one cloud."""
    mask = torch.from_numpy(chosen)
    assert cells.spreads is not None
    return PointClouds(
        cells.points[mask], cells.weights[mask], cells.spreads[mask], (0, int(mask.sum())), cells.dtype
    )


def _views(
    scene_map: SceneMap, current: PreparedScans, stations: tuple[Rays, ...], result: NoveltyResult
) -> tuple[View, ...]:
    assert result.registration is not None
    residual = np.nan_to_num(result.registration["residual_m"])
    resolution = float(np.hypot(np.fmax(scene_map.spacing, float(current.spacing[0])), residual))
    return renewed_views(scene_map.views, stations, resolution)


def _note(result: NoveltyResult, knows_origin: bool) -> str:
    if knows_origin or not result.removed.point_labels.any():
        return ""
    return (
        "Nothing was forgotten: without the place of the sensor, what has gone looks like what is out of sight; give "
        "the scan's origin."
    )
