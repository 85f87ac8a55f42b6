"""One mixture for both scans of a pair: a dictionary of components that each scan fills in its own measure.

MDL puts one component where an old and a new thing stand close together, since both scans fit it well enough
together. There the points of the two scans have different moments inside the component, which a Hellinger distance
shows without any length: such a component is split into the two Gaussians of the two scans, and EM over both scans
lets the halves find their places. Where nothing changed the moments agree and nothing is split.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

import gmmtorch
from gmmtorch import FitResult, GaussianMixtures, PointClouds, Status
from gmmtorch.components import Components
from gmmtorch.distances import hellinger_distance
from novelty.detectors.moments import Moments, claimed_moments, mixtures_of, moments_of, packed_mixtures
from novelty.detectors.resolution import blurred, cell_resolution
from novelty.detectors.united import fit_united, unite
from novelty.fitting import FitPlan, Models, fitted_clouds
from novelty.preprocess.prepared import PreparedPairs

ITERATIONS = 1
"""EM iterations over both scans after new components have come in; more would let what is new grow into a wall."""
LEAST_POINTS = 10
"""Points that each scan must have in a component for its moments to be known: as many as a Gaussian has parameters."""


def fit_shared(batch: PreparedPairs, plan: FitPlan, split_distance: float, max_splits: int) -> Models:
    """Fit one mixture to both scans of every pair; each model holds the components its scan has points of.

    Args:
        batch: P pairs.
        plan: Settings of the fit; K_max holds for both scans together, before splits.
        split_distance: Hellinger distance between the two scans inside a component above which it is split.
        max_splits: Rounds of splits.

    Returns:
        Models whose weights are the expected shares of each scan's own points.
    """
    return plan.once(
        ("shared", split_distance, max_splits), lambda: _fit_shared(batch, plan, split_distance, max_splits)
    )


def _fit_shared(batch: PreparedPairs, plan: FitPlan, split_distance: float, max_splits: int) -> Models:
    settings = plan.settings
    reference, current = (fitted_clouds(scans, settings) for scans in (batch.reference, batch.current))
    both = unite(reference, current)
    united = fit_united(batch, plan)

    def improved(start: GaussianMixtures) -> GaussianMixtures:
        return gmmtorch.fit_em(
            both,
            initial=start,
            min_std=settings.min_std,
            covariance_floor=settings.covariance_floor,
            max_iterations=ITERATIONS,
        ).mixtures

    # What both scans show, and what only one of them shows.
    common = moments_of(united.fit.mixtures, united.explained[0] + united.explained[1])
    mixtures = improved(mixtures_of(common, united.reference.groups, united.current.groups))
    # Components in which the two scans differ, each split into one per scan.
    for _ in range(max_splits):
        mixtures = improved(_split(mixtures, reference, current, cell_resolution(batch), split_distance))
    fit = replace(united.fit, mixtures=mixtures)
    return Models(reference=_share_of(reference, fit), current=_share_of(current, fit))


def _split(
    mixtures: GaussianMixtures,
    reference: PointClouds,
    current: PointClouds,
    resolution: Tensor,
    split_distance: float,
) -> GaussianMixtures:
    """The mixtures with every component in which the scans differ replaced by the two scans' own Gaussians."""
    before, after = (_blurred_moments(mixtures, cells, resolution) for cells in (reference, current))
    known = (before.counts > LEAST_POINTS) & (after.counts > LEAST_POINTS) & mixtures.mask
    differ = known & (_hellinger(before, after) > split_distance)
    total = before.counts.sum(1) + after.counts.sum(1)
    return mixtures_of(moments_of(mixtures, total).only(~differ), before.only(differ), after.only(differ))


def _blurred_moments(mixtures: GaussianMixtures, cells: PointClouds, resolution: Tensor) -> Moments:
    """Moments of each scan's cells inside every component, no finer than the resolution."""
    moments = claimed_moments(mixtures, cells, mixtures.responsibilities(cells))
    return replace(moments, covariances=blurred(moments.covariances, resolution))


def _hellinger(a: Moments, b: Moments) -> Tensor:
    """Hellinger distance between the Gaussians of the same component in two scans (P, K)."""
    return hellinger_distance(a.means, a.covariances, b.means, b.covariances).diagonal(dim1=1, dim2=2)


def _share_of(cells: PointClouds, fit: FitResult) -> FitResult:
    """The shared mixture as the mixture of one scan: its components, weighted by the scan's own points."""
    shared = fit.mixtures
    counts = shared.expected_counts(cells)
    held = torch.where(counts >= 1, counts, 0.0)
    own = Components.create(held, shared.means, shared.covariances)
    mixtures = packed_mixtures(own)
    log_prob = torch.where(cells.weights > 0, mixtures.log_prob(cells), 0.0) * cells.weights
    empty = mixtures.num_components == 0
    return FitResult(
        mixtures=mixtures,
        mdl=gmmtorch.description_length(mixtures, cells),
        mdl_path=fit.mdl_path,
        log_likelihood=torch.stack([piece.sum() for piece in cells.split(log_prob)]),
        status=torch.where(empty, int(Status.EMPTY), fit.status),
        num_iterations=fit.num_iterations,
    )
