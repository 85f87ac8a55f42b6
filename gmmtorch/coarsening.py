"""Fewer points, on which the order can be searched before all are used: some of the points, or cells of them.

`thin` takes one of so many points along a space-filling curve. What they say of a mixture is unbiased: the thickness of
a wall, and what a component more would gain, are those of all points.

`coarsen` sums the points up in the leaves of an octree. EM over cells is a lower bound of EM over the points and needs
only their count, mean and covariance (Moore 1999; Verbeek, Nunnink & Vlassis 2006). A leaf is the largest cube, of
sides halved again and again, with at most so many points: cells follow the density of the scan. In D dimensions it is
the 2^D-tree, found by sorting along a Morton curve.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import torch
from torch import Tensor

from gmmtorch.clouds import PointClouds
from gmmtorch.errors import ArgumentError
from gmmtorch.tiles import spatial_order

__all__ = ["coarsen", "thin"]

_FEWEST = 2048  # points that `thin` leaves of a larger cloud

_KEY_BITS = 60
_TABLE_BITS = 10


def thin(clouds: PointClouds, stride: int) -> PointClouds:
    """Keep one of `stride` points of every cloud, evenly along a Morton curve, in their order.

    Weights are scaled so that the total stays. At least 2 048 points are kept, all where there are no more. What is
    kept of a cloud does not depend on the others of the batch.

    Args:
        clouds: B clouds, centred and scaled to an extent of about 1 (`gmmtorch.normalization`).
        stride: points for each one that is kept.

    Raises:
        ArgumentError: if `stride` is less than 1.
    """
    if stride < 1:
        raise ArgumentError(f"stride must be >= 1, got {stride}")
    kept = []
    for here in clouds.split(spatial_order(clouds)):
        step = max(1, min(stride, len(here) // _FEWEST))
        kept.append(torch.sort(here[step // 2 :: step]).values)
    rows = torch.cat(kept)
    offsets = (0, *itertools.accumulate(len(points) for points in kept))
    spreads = None if clouds.spreads is None else clouds.spreads[rows]
    thinned = PointClouds(clouds.points[rows], clouds.weights[rows], spreads, offsets, clouds.dtype)
    scale = clouds.total_weights / thinned.total_weights.clamp_min(torch.finfo(torch.float64).tiny)
    return replace(thinned, weights=thinned.weights * scale[thinned.cloud_index])


def coarsen(clouds: PointClouds, max_points: int = 16) -> PointClouds:
    """Sum up the points of every cloud in cells of at most `max_points`.

    Points at one place share a cell, however many they are. A cell has the weight of its points, their mean and
    their covariance, spreads included; cells are in the order of their first points. The cells of a cloud do not depend
    on the others of the batch.

    Args:
        clouds: B clouds, all coordinates finite.
        max_points: points in a cell at most.

    Raises:
        ArgumentError: if `max_points` is less than 1.
    """
    if max_points < 1:
        raise ArgumentError(f"max_points must be >= 1, got {max_points}")
    if len(clouds.points) == 0:
        return replace(clouds, spreads=clouds.points.new_zeros(0, clouds.dim, clouds.dim))
    cell, first = _in_order_of_first(_leaves(clouds, max_points))
    sizes = torch.bincount(clouds.cloud_index[first], minlength=clouds.batch_size)
    weights, means, spreads = _moments(clouds, cell, first)
    offsets = (0, *sizes.cumsum(0).tolist())
    return PointClouds(means, weights, spreads, offsets, clouds.dtype)


def _leaves(clouds: PointClouds, max_points: int) -> Tensor:
    """Number of the leaf of every point (N,) int64, from 0 on, in no particular order."""
    dim, cloud = clouds.dim, clouds.cloud_index
    bits = _KEY_BITS // dim
    keys = _morton_keys(clouds, bits)
    order = torch.sort(keys, stable=True).indices
    order = order[torch.sort(cloud[order], stable=True).indices]
    keys, cloud = keys[order], cloud[order]
    leaf, settled, used = torch.zeros_like(keys), torch.zeros_like(keys, dtype=torch.bool), 0
    for level in range(bits + 1):
        cube = keys >> (dim * (bits - level))
        starts = torch.ones_like(settled)
        starts[1:] = (cube[1:] != cube[:-1]) | (cloud[1:] != cloud[:-1])
        run = starts.cumsum(0) - 1
        small = torch.bincount(run)[run] <= max_points
        # A leaf that was settled at a coarser level lies in small cubes at all finer ones.
        leaf = torch.where(settled | ~(small | (level == bits)), leaf, used + run)
        settled |= small
        used += len(run)
        if bool(settled.all()):
            break
    return torch.empty_like(leaf).scatter_(0, order, leaf)


def _morton_keys(clouds: PointClouds, bits: int) -> Tensor:
    """Place of every point along a Morton curve through the bounding cube of its cloud (N,) int64."""
    index = clouds.cloud_index[:, None].expand(-1, clouds.dim)
    corner = clouds.points.new_zeros(clouds.batch_size, clouds.dim, dtype=torch.float64)
    points = clouds.points.double()
    low = corner.scatter_reduce(0, index, points, "amin", include_self=False)
    high = corner.scatter_reduce(0, index, points, "amax", include_self=False)
    side = (high - low).amax(1).clamp_min(torch.finfo(torch.float64).tiny)  # (B,)
    place = (points - low[clouds.cloud_index]) / side[clouds.cloud_index, None] * 2**bits
    cells = place.long().clamp_(0, 2**bits - 1)  # (N, D)
    codes = torch.arange(2**_TABLE_BITS, device=clouds.device)
    apart = torch.stack([((codes >> i) & 1) << (i * clouds.dim) for i in range(_TABLE_BITS)]).sum(0)
    key = torch.zeros_like(cells[:, 0])
    for first in range(0, bits, _TABLE_BITS):
        chunk = (cells >> first) & (2**_TABLE_BITS - 1)
        for a in range(clouds.dim):
            key |= apart[chunk[:, a]] << (first * clouds.dim + a)
    return key


def _in_order_of_first(leaf: Tensor) -> tuple[Tensor, Tensor]:
    """Leaves (N,) renumbered in the order in which their first points come, and those points (C,)."""
    _, local = leaf.unique(return_inverse=True)
    points = torch.arange(len(leaf), device=leaf.device)
    first = points.new_full((int(local.max()) + 1,), len(leaf)).scatter_reduce(0, local, points, "amin")
    first, order = torch.sort(first)
    rank = torch.empty_like(order)
    rank[order] = torch.arange(len(order), device=leaf.device)
    return rank[local], first


def _moments(clouds: PointClouds, cell: Tensor, first: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Weights (C,), means (C, D) and covariances (C, D, D) of the cells."""
    points, mass, dim, count = clouds.points, clouds.weights, clouds.dim, len(first)
    weights = points.new_zeros(count).index_add_(0, cell, mass)
    # A cell of points that weigh nothing keeps their place and weighs nothing.
    mass = torch.where(weights[cell] > 0, mass, 1.0)
    divisor = points.new_zeros(count).index_add_(0, cell, mass)
    anchor = points[first]  # differences to a point of the cell lose no digits
    shift = points.new_zeros(count, dim).index_add_(0, cell, mass[:, None] * (points - anchor[cell]))
    means = anchor + shift / divisor[:, None]
    away = points - means[cell]
    second = (away[:, :, None] * away[:, None, :]).flatten(1)
    if clouds.spreads is not None:
        second = second + clouds.spreads.flatten(1)
    spreads = points.new_zeros(count, dim * dim).index_add_(0, cell, mass[:, None] * second)
    return weights, means, (spreads / divisor[:, None]).unflatten(1, (dim, dim))
