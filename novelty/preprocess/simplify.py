"""Multi-scale simplification of whole batches by binary space partition (section 2.2; Pauly et al. 2002).

A cluster P is split by the plane through its centroid whose normal is the eigenvector of its greatest
eigenvalue, while |P| > n_max or (and) sigma > sigma_max (eq. 1). The tree is grown level by level: the clusters
of one level, over all clouds, are segments of one packed array, so a level costs the same few operations however
many clusters it has. Sums run inside a segment and in scan order only, so a cloud's cells do not depend on its
company.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from gmmtorch import PointClouds
from novelty.preprocess.principal import PrincipalAxes, principal_axes

PLANE_THICKNESS = 1e-9
"""Points this near to the split plane, in standard deviations of the cluster, lie on it (regular grids do)."""
FLAT = 1e-7
"""Surface variation of exactly coplanar points may come out as large as this."""


@dataclass(frozen=True, eq=False)
class Simplified:
    """Cells of a batch.

    Attributes:
        cells: B clouds; weight = number of points, spread = their covariance; ordered by smallest point index.
        cell_of_point: int64 (N,), row of `cells.points` that holds each point.
    """

    cells: PointClouds
    cell_of_point: torch.Tensor


@dataclass(frozen=True)
class Scale:
    """When a cluster is split."""

    rule: Literal["or", "and"] = "or"
    max_size: int = 20
    max_surface_variation: float = 0.1

    def splits(self, sizes: torch.Tensor, surface_variation: torch.Tensor) -> torch.Tensor:
        """Whether clusters with these |P| and sigma are split, bool (S,)."""
        large = sizes > self.max_size
        curved = surface_variation > max(self.max_surface_variation, FLAT)
        return large | curved if self.rule == "or" else large & curved


@dataclass(frozen=True, eq=False)
class _Clusters:
    """S clusters of one level: points (3, N), their place in the batch (N,), and how many each has (S,)."""

    points: torch.Tensor
    places: torch.Tensor
    sizes: torch.Tensor


@dataclass(frozen=True, eq=False)
class _Moments:
    """Of S clusters: means (3, S), covariances xx, xy, xz, yy, yz, zz (6, S), what is needed to split them."""

    owners: torch.Tensor  # (N,)
    offsets: torch.Tensor  # (3, N), point minus its cluster's mean
    means: torch.Tensor
    covariances: torch.Tensor


@dataclass(frozen=True, eq=False)
class _Leaves:
    """Finished clusters of one level: sizes (S,), places of their points (N,), means (3, S), covariances (6, S)."""

    sizes: torch.Tensor
    places: torch.Tensor
    means: torch.Tensor
    covariances: torch.Tensor


def simplify(clouds: PointClouds, scale: Scale) -> Simplified:
    """Cells of every cloud of the batch.

    A cluster whose points are identical is never split, whatever its size. Every level reads a few sizes back
    from the device.

    Args:
        clouds: Points (N, 3), all of weight 1.
        scale: When a cluster is split.
    """
    # Coordinates relative to the cloud's mean: maps may lie at 5e5 m.
    sizes = torch.tensor(clouds.sizes, device=clouds.device)
    centres = _segment_means(clouds.points.T.contiguous(), sizes)  # (3, B)
    local = clouds.points.T - centres[:, clouds.cloud_index]  # (3, N)
    places = torch.arange(len(clouds.points), device=local.device)
    level = _Clusters(local.contiguous(), places, sizes[sizes > 0])
    leaves: list[_Leaves] = []
    while not leaves or len(level.sizes):
        finished, level = _grow(level, scale)
        leaves.append(finished)
    return _packed(leaves, clouds, centres)


def _grow(level: _Clusters, scale: Scale) -> tuple[_Leaves, _Clusters]:
    """One level of the tree: the clusters that stay, and the two halves of each of the others."""
    moments = _moments(level)
    axes = principal_axes(moments.covariances)
    beyond = _beyond_plane(moments, axes)  # (N,)
    num_beyond = _segment_sums(beyond.to(level.points.dtype)[None], level.sizes)[0].long()
    divides = (num_beyond > 0) & (num_beyond < level.sizes)
    split = scale.splits(level.sizes, axes.surface_variation) & divides  # (S,)
    point_split = split.index_select(0, moments.owners)  # (N,)
    finished = _Leaves(
        sizes=level.sizes[~split],
        places=level.places[~point_split],
        means=moments.means[:, ~split],
        covariances=moments.covariances[:, ~split],
    )
    return finished, _halves(level, point_split, beyond, split, num_beyond)


def _moments(level: _Clusters) -> _Moments:
    sizes = level.sizes
    owners = torch.repeat_interleave(sizes, output_size=level.points.shape[1])
    means = _segment_means(level.points, sizes)
    offsets = level.points - means.index_select(1, owners)
    products = offsets.new_empty(6, offsets.shape[1])
    for row, (first, second) in zip(products, ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), strict=True):
        torch.mul(offsets[first], offsets[second], out=row)
    return _Moments(owners, offsets, means, _segment_means(products, sizes))


def _beyond_plane(moments: _Moments, axes: PrincipalAxes) -> torch.Tensor:
    """Whether each point lies on the positive side of its cluster's split plane, bool (N,)."""
    margins = PLANE_THICKNESS * axes.variance.clamp_min(0).sqrt()  # (S,)
    heights = axes.direction.index_select(1, moments.owners).mul_(moments.offsets).sum(0)  # (N,)
    return heights > margins.index_select(0, moments.owners)


def _halves(
    level: _Clusters,
    point_split: torch.Tensor,
    beyond: torch.Tensor,
    split: torch.Tensor,
    num_beyond: torch.Tensor,
) -> _Clusters:
    """The halves of the split clusters, lower half first, each in scan order."""
    upper_sizes = num_beyond[split]
    lower_sizes = level.sizes[split] - upper_sizes
    lower = torch.nonzero(point_split & ~beyond)[:, 0]
    upper = torch.nonzero(point_split & beyond)[:, 0]
    # The j-th point of all lower halves comes after the upper halves of the clusters before its own, and the
    # j-th point of all upper halves after the lower halves up to its own.
    source = torch.empty(len(lower) + len(upper), dtype=torch.long, device=lower.device)
    source[_ranks(lower, upper_sizes.cumsum(0) - upper_sizes, lower_sizes)] = lower
    source[_ranks(upper, lower_sizes.cumsum(0), upper_sizes)] = upper
    sizes = torch.stack([lower_sizes, upper_sizes], dim=1).reshape(-1)
    return _Clusters(level.points.index_select(1, source), level.places.index_select(0, source), sizes)


def _ranks(members: torch.Tensor, before: torch.Tensor, sizes: torch.Tensor) -> torch.Tensor:
    count = len(members)
    shifts = before.repeat_interleave(sizes, output_size=count)
    return torch.arange(count, device=members.device) + shifts


def _segment_sums(values: torch.Tensor, sizes: torch.Tensor) -> torch.Tensor:
    """Sums over consecutive runs of columns: (C, N), (S,) -> (C, S)."""
    bounds = torch.nn.functional.pad(sizes.cumsum(0), (1, 0))
    return torch.segment_reduce(
        values, "sum", offsets=bounds.expand(len(values), -1).contiguous(), axis=1, unsafe=True, initial=0
    )


def _segment_means(values: torch.Tensor, sizes: torch.Tensor) -> torch.Tensor:
    return _segment_sums(values, sizes) / sizes.clamp_min(1)


def _packed(leaves: list[_Leaves], clouds: PointClouds, centres: torch.Tensor) -> Simplified:
    """Collect the leaves of all levels and order them by the smallest index of their points."""
    sizes = torch.cat([leaf.sizes for leaf in leaves])  # (S,)
    places = torch.cat([leaf.places for leaf in leaves])  # (N,)
    means = torch.cat([leaf.means for leaf in leaves], dim=1)  # (3, S)
    covariances = torch.cat([leaf.covariances for leaf in leaves], dim=1)  # (6, S)
    # Points keep their order at every split: the first of a cell has its smallest index.
    first, order = torch.sort(places[sizes.cumsum(0) - sizes])
    rank = torch.empty_like(order)
    rank[order] = torch.arange(len(order), device=order.device)
    cell_of_point = torch.empty_like(places)
    cell_of_point[places] = rank.repeat_interleave(sizes, output_size=len(places))
    bounds = torch.searchsorted(first, torch.tensor(clouds.offsets, device=clouds.device))
    cells = PointClouds(
        points=(means[:, order] + centres[:, clouds.cloud_index[first]]).T.contiguous(),
        weights=sizes[order].to(clouds.points.dtype),
        spreads=covariances[[0, 1, 2, 1, 3, 4, 2, 4, 5]][:, order].T.reshape(-1, 3, 3),
        offsets=tuple(bounds.tolist()),
    )
    return Simplified(cells=cells, cell_of_point=cell_of_point)
