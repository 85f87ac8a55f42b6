"""Unsupervised fuzzy partitions, the optimal number of classes (UFP-ONC; Gath & Geva 1989; Lomenie 2004).

For K = 1, 2, ... a fuzzy k-means finds prototypes, fuzzy maximum-likelihood estimates refine them, and validity
measures say how good the partition is. Each K starts from the prototypes of the one before and one more, equally far
from all points, so that nothing is random.

The exponential distance d^2 = det(F)^(1/2) / P exp((x - V)^T F^-1 (x - V) / 2) makes the membership 1 / d^2, divided by
its sum over the clusters, the posterior of a Gaussian mixture of weights P, means V and covariances F. It is taken
in the log domain, where nothing overflows. What remains of fuzziness is in the prototypes, which weigh points by u^2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import torch
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from novelty.baselines.clustered import clustered_mixtures

Validity = Literal["hypervolume", "average_density", "density"]

FUZZINESS = 2.0
"""q, the power of the memberships that weighs points in the prototypes."""

FAR = 10.0
"""How far a new prototype is from every point, in standard deviations of the cloud."""


@dataclass(frozen=True, eq=False)
class FuzzyPartitions:
    """The partitions of B clouds into K = 1 ... K_max fuzzy clusters.

    Attributes:
        mixtures: For every K, the clusters (P_k, V_k, F_k) as B mixtures; `mixtures[K - 1]` has K components.
        hypervolume: F_HV = sum_k det(F_k)^(1/2) (B, K_max), m^3; the least is the best.
        average_density: D_PA = 1/K sum_k S_k / det(F_k)^(1/2) (B, K_max), m^-3; the greatest is the best.
        density: P_D = sum_k S_k / F_HV (B, K_max), m^-3; the greatest is the best.
        num_iterations: Updates of both algorithms at every K (B, K_max).

    S_k = sum of u_nk over the central members, the points with (x_n - V_k)^T F_k^-1 (x_n - V_k) < 1.
    """

    mixtures: tuple[GaussianMixtures, ...]
    hypervolume: Tensor
    average_density: Tensor
    density: Tensor
    num_iterations: Tensor

    def best(self, validity: Validity = "density") -> list[int]:
        """The number of clusters of every cloud by a measure of validity, the smallest of equals."""
        measure = getattr(self, validity)
        at = measure.argmin(1) if validity == "hypervolume" else measure.argmax(1)
        return (at + 1).tolist()

    def taken(self, orders: list[int]) -> GaussianMixtures:
        """The clusters of every cloud at these numbers of them (B,)."""
        return GaussianMixtures.from_list([self.mixtures[k - 1][b] for b, k in enumerate(orders)])


def fit_fuzzy_partitions(
    clouds: PointClouds, max_clusters: int = 9, *, tolerance: float = 0.01, max_iterations: int = 100
) -> FuzzyPartitions:
    """Partition every cloud into 1, 2, ... `max_clusters` fuzzy clusters.

    Args:
        clouds: B clouds, m.
        max_clusters: K_max.
        tolerance: Either algorithm stops when no membership of a cloud changes by more.
        max_iterations: Updates of either algorithm at each K at most.
    """
    centre = torch.stack(
        [part.mean(0) if len(part) else part.new_zeros(clouds.dim) for part in clouds.split(clouds.points)]
    )
    local = replace(clouds, points=clouds.points - centre[clouds.cloud_index])
    settle = _Settling(local, tolerance, max_iterations)
    found, measures, counts = [], [], []
    prototypes = local.points.new_zeros(clouds.batch_size, 0, clouds.dim)
    for _ in range(max_clusters):
        memberships = kmeans_memberships(local, prototypes, distant=True)
        memberships, first = settle(_kmeans_update, memberships)
        memberships, second = settle(_likelihood_update, memberships)
        clusters = _estimate(local, memberships)
        prototypes = clusters.means
        measures.append(validity_measures(local, clusters, memberships))
        counts.append(first + second)
        found.append(replace(clusters, means=clusters.means + centre[:, None]))
    hypervolume, average_density, density = (torch.stack(values, 1) for values in zip(*measures, strict=True))
    return FuzzyPartitions(tuple(found), hypervolume, average_density, density, torch.stack(counts, 1))


def kmeans_memberships(clouds: PointClouds, prototypes: Tensor, distant: bool = False) -> Tensor:
    """u_nk = d_nk^-2 / sum_l d_nl^-2 (N, K), memberships of fuzzy k-means at q = 2 (Gath & Geva 1989, eq. 2).

    Args:
        clouds: B clouds.
        prototypes: V_k (B, K, D), m.
        distant: Whether one more prototype, K + 1 in all, is equally far from all points.
    """
    pairs = zip(clouds.split(clouds.points), prototypes, strict=True)
    squared = torch.cat([torch.cdist(x, v).square() for x, v in pairs])  # (N, K)
    if distant:
        extent = torch.stack(
            [part.square().sum(1).mean() for part in clouds.split(clouds.points)]
        ).nan_to_num(1.0)
        far = FAR**2 * extent.clamp_min(torch.finfo(extent.dtype).tiny)
        squared = torch.cat([squared, far[clouds.cloud_index, None]], 1)
    nearness = 1 / squared.clamp_min(torch.finfo(squared.dtype).tiny ** 0.5)
    return nearness / nearness.sum(1, keepdim=True)


def alpha_cut(memberships: Tensor, threshold: float = 0.2) -> Tensor:
    """The cluster of every point: argmax_k u_nk where that exceeds the threshold S, else -1 (N,)."""
    most, cluster = memberships.max(1)
    return torch.where(most > threshold, cluster, -1)


def validity_measures(
    clouds: PointClouds, clusters: GaussianMixtures, memberships: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """F_HV, D_PA and P_D of a partition (B,) each (Gath & Geva 1989, eqs. 13-17); see `FuzzyPartitions`."""
    factors = torch.linalg.cholesky(clusters.covariances)
    volumes = factors.diagonal(dim1=-2, dim2=-1).prod(-1)  # (B, K)
    central = _central(clouds, clusters.means, factors)
    held = clouds.split(torch.where(central, memberships, 0.0) * clouds.weights[:, None])
    members = torch.stack([part.sum(0) for part in held])  # S_k (B, K)
    hypervolume = volumes.sum(1)
    return hypervolume, (members / volumes).mean(1), members.sum(1) / hypervolume


def _central(clouds: PointClouds, means: Tensor, factors: Tensor) -> Tensor:
    """Whether (x_n - V_k)^T F_k^-1 (x_n - V_k) < 1, bool (N, K)."""
    identity = torch.eye(clouds.dim, dtype=factors.dtype, device=factors.device).expand_as(factors)
    whitening = torch.linalg.solve_triangular(factors, identity, upper=False)  # (B, K, D, D)
    pieces = zip(clouds.split(clouds.points), means, whitening, strict=True)
    squared = [
        torch.einsum("kde,nke->nkd", whiten, points[:, None] - centres).square().sum(-1)
        for points, centres, whiten in pieces
    ]
    return torch.cat(squared) < 1


def _prototypes(clouds: PointClouds, memberships: Tensor) -> Tensor:
    """V_k = sum_n u_nk^q x_n / sum_n u_nk^q (B, K, D), eq. 3."""
    weights = memberships**FUZZINESS * clouds.weights[:, None]
    pairs = zip(clouds.split(weights), clouds.split(clouds.points), strict=True)
    tiny = torch.finfo(weights.dtype).tiny
    return torch.stack([w.T @ x / w.sum(0).clamp_min(tiny)[:, None] for w, x in pairs])


def _kmeans_update(clouds: PointClouds, memberships: Tensor) -> Tensor:
    return kmeans_memberships(clouds, _prototypes(clouds, memberships))


def _likelihood_update(clouds: PointClouds, memberships: Tensor) -> Tensor:
    return _estimate(clouds, memberships).responsibilities(clouds)


def _estimate(clouds: PointClouds, memberships: Tensor) -> GaussianMixtures:
    return clustered_mixtures(clouds, memberships, FUZZINESS)


Update = Callable[[PointClouds, Tensor], Tensor]
"""From the memberships of points (N, K) to better ones."""


@dataclass(frozen=True, eq=False)
class _Settling:
    """Repeats an update of the memberships until those of every cloud have settled."""

    clouds: PointClouds
    tolerance: float
    max_iterations: int

    def __call__(self, update: Update, memberships: Tensor) -> tuple[Tensor, Tensor]:
        """The settled memberships (N, K), and the updates made (B,); a cloud that has settled is left out."""
        settled = list(self.clouds.split(memberships))
        updates = torch.zeros(len(settled), dtype=torch.long)
        running = [b for b, size in enumerate(self.clouds.sizes) if size]
        for _ in range(self.max_iterations if running else 0):
            clouds = self.clouds.select(running)
            before = torch.cat([settled[b] for b in running])
            after = update(clouds, before)
            largest = [part.amax() for part in clouds.split((after - before).abs())]
            for b, part in zip(running, clouds.split(after), strict=True):
                settled[b] = part
                updates[b] += 1
            running = [b for b, change in zip(running, largest, strict=True) if change > self.tolerance]
            if not running:
                break
        return torch.cat(settled), updates
