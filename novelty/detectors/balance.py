"""How much each scan of a pair has of every component, and the common ratio of what both have."""

from __future__ import annotations

import torch
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from novelty.detectors.quantiles import weighted_quantiles
from novelty.fitting import Models
from novelty.preprocess.prepared import PreparedPairs


def expected_counts(mixtures: GaussianMixtures, cells: PointClouds) -> Tensor:
    """Expected number of points of every component, sum_n w_n r_nk (P, K)."""
    claims = mixtures.responsibilities(cells) * cells.weights[:, None]  # (N, K)
    return torch.stack([piece.sum(0) for piece in cells.split(claims)])


def pooled_counts(batch: PreparedPairs, models: Models) -> tuple[Tensor, Tensor]:
    """Expected counts of the current and of the reference scans in the components of both mixtures (P, K + K').

    The current mixtures' components come first. A component that both mixtures hold claims its points in two copies
    of one ratio; mixtures that share no component compete for the points of both scans.

    Returns:
        The counts of the current and of the reference scans; all 0 where a scan is empty, since nothing compares.
    """
    reference, current = batch.reference.cells, batch.current.cells
    pooled = _pooled(models, current.total_weights, reference.total_weights)
    own, other = (expected_counts(pooled, cells) for cells in (current, reference))
    comparable = (own.sum(1, keepdim=True) > 0) & (other.sum(1, keepdim=True) > 0)
    return torch.where(comparable, own, 0.0), torch.where(comparable, other, 0.0)


def log_density_ratio(own: Tensor, other: Tensor) -> Tensor:
    """Log of the common ratio own / other of the counts (P, K) of components that both scans have (P,).

    A component has a say as far as both scans have it: what is new or gone has none, however large it is. Scans that
    share less than a point anywhere are taken as equally dense, 0.
    """
    both = torch.minimum(own, other)
    return balanced_median((own / other).log(), torch.where(both >= 1, both, 0.0))


def balanced_median(values: Tensor, weights: Tensor) -> Tensor:
    """Weighted median of the finite values (P, K) of every pair (P,); 0 where there are none.

    The middle between the lower and the upper median, so that opposite values have the opposite median.
    """
    rows = torch.arange(len(values), device=values.device)[:, None].expand_as(values)
    groups = torch.where(values.isfinite(), rows, -1).flatten()

    def lower(some: Tensor) -> Tensor:
        return weighted_quantiles(some.flatten(), weights.flatten(), groups, len(values), 0.5)

    return (0.5 * (lower(values) - lower(-values))).nan_to_num(0.0)


def _pooled(models: Models, current_points: Tensor, reference_points: Tensor) -> GaussianMixtures:
    """All components of both mixtures as one: a component that both hold claims its points in two equal copies."""
    sides = models.current.mixtures, models.reference.mixtures
    masses = [m.weights * n[:, None] for m, n in zip(sides, (current_points, reference_points), strict=True)]
    weights = torch.cat(masses, 1)
    return GaussianMixtures(
        weights=weights / weights.sum(1, keepdim=True).clamp_min(torch.finfo(weights.dtype).tiny),
        means=torch.cat([m.means for m in sides], 1),
        covariances=torch.cat([m.covariances for m in sides], 1),
        num_components=sides[0].num_components + sides[1].num_components,
    )
