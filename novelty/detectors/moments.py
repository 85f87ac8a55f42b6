"""Moments of groups of points, and the mixtures made of them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.components import Components
from gmmtorch.linalg import num_lifted, triangle, unpack_symmetric


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


def moments_of(mixtures: GaussianMixtures, points: Tensor) -> Moments:
    """Mixtures of that many points, (P,)."""
    return Moments(mixtures.weights * points[:, None], mixtures.means, mixtures.covariances)


def claimed_moments(mixtures: GaussianMixtures, cells: PointClouds, responsibilities: Tensor) -> Moments:
    """Moments of the points that each component claims in its scan's cells; those of nothing are 0 and I.

    Args:
        mixtures: P mixtures, which tell where the scans lie: maps are far from zero.
        cells: P clouds of cells.
        responsibilities: of the components for every cell (N, K).
    """
    origin = (mixtures.weights[..., None] * mixtures.means).sum(1)  # (P, 3)
    features = _features(cells, origin).mul_(cells.weights)  # (10, N)
    pieces = zip(cells.split(responsibilities), cells.split(features.T), strict=True)
    sums = torch.stack([claims.T @ values for claims, values in pieces])  # (P, K, 10)
    return _moments(sums, origin)


def _features(cells: PointClouds, origin: Tensor) -> Tensor:
    """1, x and the upper triangle of x x^T + Q of every cell, x from the origin of its scan (10, N)."""
    features = cells.points.new_empty(num_lifted(cells.dim), len(cells.points))  # on the rows: fast to fill
    features[0] = 1.0
    offsets = features[1 : cells.dim + 1]
    torch.sub(cells.points.T, origin.index_select(0, cells.cloud_index).T, out=offsets)
    rows, columns = triangle(cells.dim)
    for square, a, b in zip(features[cells.dim + 1 :], rows, columns, strict=True):
        torch.mul(offsets[a], offsets[b], out=square)
        if cells.spreads is not None:
            square.add_(cells.spreads[:, a, b])
    return features


def _moments(sums: Tensor, origin: Tensor) -> Moments:
    """From the sums of the features (P, K, 10)."""
    dim = origin.shape[-1]
    counts = sums[..., 0]
    averages = sums[..., 1:] / counts.clamp_min(torch.finfo(counts.dtype).tiny)[..., None]
    first, second = averages[..., :dim], unpack_symmetric(averages[..., dim:], dim)
    present = (counts > 0)[..., None]
    identity = torch.eye(dim, dtype=counts.dtype, device=counts.device)
    covariances = second - first[..., :, None] * first[..., None, :]
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
