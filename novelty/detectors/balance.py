"""How much each scan of a pair has of every component, and the common ratio of what both have."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.components import Components
from novelty.detectors.moments import packed_mixtures
from novelty.detectors.quantiles import weighted_quantiles
from novelty.fitting import Models
from novelty.preprocess.prepared import PreparedPairs


def pooled_counts(batch: PreparedPairs, models: Models) -> tuple[Tensor, Tensor]:
    """Expected counts of the current and of the reference scans in the components of both mixtures (P, K + K').

    The current mixtures' components come first. A component that both mixtures hold claims its points in two copies
    of one ratio; mixtures that share no component compete for the points of both scans.

    Returns:
        The counts of the current and of the reference scans; all 0 where a scan is empty, since nothing compares.
    """
    reference, current = batch.reference.cells, batch.current.cells
    pooled = _Pool.of(models, current.total_weights, reference.total_weights)
    own, other = (pooled.counts(cells) for cells in (current, reference))
    comparable = (own.sum(1, keepdim=True) > 0) & (other.sum(1, keepdim=True) > 0)
    return torch.where(comparable, own, 0.0), torch.where(comparable, other, 0.0)


def pooled_cells(batch: PreparedPairs, models: Models) -> Tensor:
    """Expected number of cells, of both scans together, in the components of both mixtures (P, K + K')."""
    reference, current = batch.reference.cells, batch.current.cells
    pooled = _Pool.of(models, current.total_weights, reference.total_weights)
    own, other = (
        pooled.counts(replace(cells, weights=(cells.weights > 0).to(cells.weights)))
        for cells in (current, reference)
    )
    return own + other


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


@dataclass(frozen=True, eq=False)
class _Pool:
    """All components of both mixtures as one mixture, in which a component that both hold stands once.

    Attributes:
        distinct: the mixture.
        places: component of `distinct` that each of both mixtures' components is (P, K + K').
        parts: share of it that belongs to that copy (P, K + K'); 0 for padding.
    """

    distinct: GaussianMixtures
    places: Tensor
    parts: Tensor

    @classmethod
    def of(cls, models: Models, current_points: Tensor, reference_points: Tensor) -> _Pool:
        """Pool the mixtures, each weighted by the points of its scan."""
        current, reference = models.current.mixtures, models.reference.mixtures
        masses = torch.cat(
            [current.weights * current_points[:, None], reference.weights * reference_points[:, None]], 1
        )
        places = _places(current, reference)
        together = torch.zeros_like(masses).scatter_add_(1, places, masses)
        means = torch.cat([current.means, reference.means], 1)
        covariances = torch.cat([current.covariances, reference.covariances], 1)
        return cls(
            distinct=packed_mixtures(Components.create(together, means, covariances)),
            places=((together > 0).cumsum(1) - 1).clamp_min(0).gather(1, places),
            parts=torch.where(masses > 0, masses / together.gather(1, places), 0.0),
        )

    def counts(self, cells: PointClouds) -> Tensor:
        """Expected number of points of every component of both mixtures (P, K + K')."""
        return self.distinct.expected_counts(cells).gather(1, self.places) * self.parts


def _places(current: GaussianMixtures, reference: GaussianMixtures) -> Tensor:
    """Of all components in a row, which one each is: itself, or for the reference's its current copy (P, K + K')."""
    numbers = torch.arange(current.num_slots + reference.num_slots, device=current.weights.device)
    own, others = numbers.expand(len(current), -1).split([current.num_slots, reference.num_slots], dim=1)
    equal = _equal(current, reference)  # (P, K, K')
    return torch.cat([own, torch.where(equal.any(1), equal.int().argmax(1), others)], 1)


def _equal(a: GaussianMixtures, b: GaussianMixtures) -> Tensor:
    """Whether a component of a is one of b, digit for digit (P, K, K')."""
    same_means = (a.means[:, :, None] == b.means[:, None, :]).all(-1)
    same_shapes = (a.covariances[:, :, None] == b.covariances[:, None, :]).flatten(3).all(-1)
    return same_means & same_shapes & a.mask[:, :, None] & b.mask[:, None, :]
