"""Moments of groups of points, and the mixtures made of them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.components import Components


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments of K groups of points of every of P scans.

    Attributes:
        counts: expected number of points (P, K); 0 for a group that is not there.
        means: (P, K, 3), m.
        covariances: (P, K, 3, 3), m^2.
    """

    counts: Tensor
    means: Tensor
    covariances: Tensor

    def only(self, chosen: Tensor) -> Moments:
        """These moments with the counts of all other groups 0; `chosen` bool (P, K)."""
        return Moments(torch.where(chosen, self.counts, 0.0), self.means, self.covariances)

    def split(self, size: int) -> tuple[Moments, Moments]:
        """The first `size` groups, and the others."""
        fields = (self.counts, self.means, self.covariances)
        return Moments(*(values[:, :size] for values in fields)), Moments(
            *(values[:, size:] for values in fields)
        )


def moments_of(mixtures: GaussianMixtures, points: Tensor) -> Moments:
    """Mixtures of that many points, (P,)."""
    return Moments(mixtures.weights * points[:, None], mixtures.means, mixtures.covariances)


def claimed_moments(mixtures: GaussianMixtures, cells: PointClouds, claims: Tensor) -> Moments:
    """Moments of what each component claims of its scan's cells; those of nothing are 0 and I.

    Args:
        mixtures: P mixtures, which tell where the scans lie: maps are far from zero.
        cells: P clouds of cells.
        claims: points of every cell that each component claims (N, K).
    """
    spreads = cells.spreads
    if spreads is None:
        spreads = cells.points.new_zeros(len(cells.points), cells.dim, cells.dim)
    origin = (mixtures.weights[..., None] * mixtures.means).sum(1)  # (P, 3)
    offsets = cells.points - origin[cells.cloud_index]
    squares = (offsets[:, :, None] * offsets[:, None, :] + spreads).flatten(1)  # (N, 9)
    pieces = cells.split(claims)
    counts = torch.stack([piece.sum(0) for piece in pieces])
    held = counts.clamp_min(torch.finfo(counts.dtype).tiny)[..., None]
    first, second = (
        torch.stack([piece.T @ part for piece, part in zip(pieces, cells.split(values), strict=True)]) / held
        for values in (offsets, squares)
    )
    covariances = second.unflatten(2, (cells.dim, cells.dim)) - first[..., :, None] * first[..., None, :]
    present = (counts > 0)[..., None]
    identity = torch.eye(cells.dim, dtype=counts.dtype, device=counts.device)
    return Moments(
        counts=counts,
        means=torch.where(present, first + origin[:, None], 0.0),
        covariances=torch.where(present[..., None], covariances, identity),
    )


def mixtures_of(*parts: Moments) -> GaussianMixtures:
    """One component per group of all parts, weighted by its points; the parts keep their order."""
    return packed_mixtures(
        Components.create(
            torch.cat([part.counts for part in parts], 1),
            torch.cat([part.means for part in parts], 1),
            torch.cat([part.covariances for part in parts], 1),
        )
    )


def packed_mixtures(components: Components) -> GaussianMixtures:
    """The components that are present, in order."""
    packed = components.compact(components.weights.shape[1])
    return GaussianMixtures(packed.weights, packed.means, packed.covariances, packed.num_components).trim()
