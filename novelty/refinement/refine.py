"""Labels finer than components: a component that is half old, half new must not spoil its points.

A detector gives one verdict for all points of a component. Here every cell of simplification is judged by its own
points: it is novel when most of them are off the surface that the other scan measured. A component that the detector
calls novel and that is off the surface nearly as a whole keeps all its points, so that the feet of a thing that
touches the floor stay with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import torch
from pydantic import Field
from scipy.special import chdtri

from novelty.preprocess import PreparedScans
from novelty.refinement.chance import chance_group_sizes
from novelty.refinement.surface import chance_of, own_distances, surface_distances
from novelty.section import section
from novelty.segment import SegmentedPoints, states_of
from novelty.visibility import filled_between_lines, has_stations

ROUGHNESS_AT = 0.95
"""Quantile at which a scan's own distances from its surfaces are compared with those of Gaussian noise."""


@section
class Refine:
    """How labels are refined inside components."""

    method: Literal["surface", "none"] = Field(
        default="surface",
        description="surface: every cell is judged by its distance from the other scan's surface; none: every point "
        "follows its component, so that the detector alone decides.",
    )
    false_alarm: float = Field(
        default=1e-3,
        gt=0,
        lt=1,
        description="Share of unchanged points that may be off the surface by chance; sets the distance, no length.",
    )
    whole: float = Field(
        default=0.8,
        gt=0,
        le=1,
        description="A novel component keeps all its points when at least this share of them is off the surface.",
    )


@dataclass(frozen=True, eq=False)
class OffSurface:
    """How far the points of B scans are off the surfaces that the others measured; no detector has a say in it.

    Attributes:
        distances: squared, in variances of the surface (N,).
        p_values: (N,), probability of a distance as large without any change, see `chance_of`.
        off: bool (N,), farther than unchanged points are.
        comparable: bool (N,), False where the other scan is empty.
        chance_groups: int64 (B,), see `chance_group_sizes`; looked at where the other scan's rays cannot tell.
    """

    distances: torch.Tensor
    p_values: torch.Tensor
    off: torch.Tensor
    comparable: torch.Tensor
    chance_groups: torch.Tensor


def measure_off_surface(
    scans: PreparedScans, other: PreparedScans, resolution: torch.Tensor, settings: Refine
) -> OffSurface:
    """Measure B scans against the scans they are compared with.

    Args:
        scans: The B scans.
        other: The B scans they are compared with, in the same frame.
        resolution: (B,) m, see `surface_distances`.
        settings: How to refine.
    """
    distances = surface_distances(scans.points, filled_between_lines(other), resolution)
    comparable = torch.tensor([size > 0 for size in other.cells.sizes])[scans.points.cloud_index]
    own = own_distances(scans.points, scans.cell_of_point, resolution)
    threshold = _threshold(own, settings)  # (B,)
    off = (distances > threshold[scans.points.cloud_index]) & comparable
    blind = [
        bool(part.any()) and not has_stations(origins)
        for part, origins in zip(scans.points.split(off), other.origins, strict=True)
    ]
    return OffSurface(
        distances=distances,
        p_values=chance_of(distances, scans.points, own),
        off=off,
        comparable=comparable,
        chance_groups=chance_group_sizes(scans, resolution, threshold, blind),
    )


def refine(
    segmented: SegmentedPoints, scans: PreparedScans, surface: OffSurface, settings: Refine
) -> SegmentedPoints:
    """Refine the labels of B scans against the scans they were compared with.

    Args:
        segmented: Labels that follow the components.
        scans: The B scans labelled.
        surface: How far their points are off the others' surfaces.
        settings: How to refine.

    Returns:
        The same with refined labels; the scores are distances from the other scan's surface in standard deviations,
        the p-values how probable these are without a change. A scan compared with an empty one keeps what it has.
    """
    whole = segmented.labels & (_share_off(surface.off, segmented, scans) >= settings.whole)
    refined = states_of(whole | _majority_of_cell(surface.off, scans.cell_of_point))
    return replace(
        segmented,
        states=torch.where(surface.comparable, refined, segmented.states),
        scores=torch.where(surface.comparable, surface.distances.sqrt(), segmented.scores),
        p_values=torch.where(surface.comparable, surface.p_values, segmented.p_values),
    )


def _threshold(own: tuple[torch.Tensor, ...], settings: Refine) -> torch.Tensor:
    """Squared distance that unchanged points exceed with probability `false_alarm` (B,).

    The quantile of chi-squared for Gaussian noise, stretched where the scan's own surfaces are rougher than that. How
    much rougher is read off a quantile of its `own_distances` that a few stray returns do not move.
    """
    smooth = float(chdtri(3, 1 - ROUGHNESS_AT))
    rougher = [max(float(part.quantile(ROUGHNESS_AT)) / smooth, 1.0) if len(part) else 1.0 for part in own]
    return torch.tensor(rougher, dtype=torch.float64) * float(chdtri(3, settings.false_alarm))


def _share_off(off: torch.Tensor, segmented: SegmentedPoints, scans: PreparedScans) -> torch.Tensor:
    """Share of the points of each point's component that are off the surface (N,)."""
    num_components = segmented.counts.shape[1]
    slot = scans.points.cloud_index * num_components + segmented.components
    count = torch.bincount(slot, minlength=segmented.counts.numel())
    hits = torch.bincount(slot, weights=off.double(), minlength=segmented.counts.numel())
    return (hits / count)[slot]


def _majority_of_cell(off: torch.Tensor, cell_of_point: torch.Tensor) -> torch.Tensor:
    """Whether more than half of the points of each point's cell are off the surface (N,)."""
    if not len(off):
        return off
    share = torch.bincount(cell_of_point, weights=off.double()) / torch.bincount(cell_of_point)
    return share[cell_of_point] > 0.5
