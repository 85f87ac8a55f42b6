"""Summarise clouds by few cells: the sufficient statistics of small patches, from which EM can go on.

A cell is halved by the plane through its mean that is normal to its longest axis (binary space partition, section 2.2;
Pauly et al. 2002), level by level for all cells of all clouds at once, until none holds more than its share of the
cloud's weight. Moments merge exactly: weight, mean and covariance of a summary are those of its points.
"""

from __future__ import annotations

from itertools import accumulate

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.clouds import PointClouds
from gmmtorch.errors import ArgumentError, ShapeError

__all__ = ["summarize"]

_MAX_LEVELS = 64  # halvings of one cell; only a far outlier among many points comes near


@torch.no_grad()
def summarize(clouds: PointClouds, num_cells: int, groups: Tensor | None = None) -> PointClouds:
    """Merge the points or cells of every cloud into about `num_cells` cells; synchronises the device.

    Args:
        clouds: the batch; all values finite.
        num_cells: a cell is halved while it weighs more than 1 / num_cells of its cloud.
        groups: number of every point's group (N,) int64; a cell never mixes groups. Points of group -1 are left out.

    Returns:
        Cells in the caller's units. One that holds a single heavy cell, or points of one place, may weigh more.

    Raises:
        ArgumentError: if `num_cells` is less than 1.
        ShapeError: if there is not one group per point.
    """
    if num_cells < 1:
        raise ArgumentError(f"num_cells must be at least 1, got {num_cells}")
    groups = torch.zeros_like(clouds.cloud_index) if groups is None else groups
    if groups.shape != clouds.weights.shape:
        raise ShapeError(f"expected groups of shape {tuple(clouds.weights.shape)}, got {tuple(groups.shape)}")
    kept = (clouds.weights > 0) & (groups >= 0)
    owner, weights = clouds.cloud_index[kept], clouds.weights[kept]
    origin = torch.stack([_center(points) for points in clouds.split(clouds.points)])
    local = clouds.points[kept] - origin[owner]
    share = (clouds.total_weights / num_cells)[owner]
    cell = _halved(local, weights, share, torch.stack([owner, groups[kept]], 1))
    spreads = None if clouds.spreads is None else clouds.spreads[kept]
    total, means, covariances = _moments(local, weights, spreads, cell)
    cloud = torch.zeros_like(total, dtype=torch.int64).index_copy(0, cell, owner)
    sizes = torch.bincount(cloud, minlength=clouds.batch_size).tolist()
    return PointClouds(means + origin[cloud], total, covariances, (0, *accumulate(sizes)), clouds.dtype)


def _center(points: Tensor) -> Tensor:
    """Coordinate-wise median (D,): moments about it lose no digits, be there map coordinates or a far outlier."""
    return points.median(0).values if len(points) else points.new_zeros(points.shape[1])


def _halved(points: Tensor, weights: Tensor, share: Tensor, first: Tensor) -> Tensor:
    """Cell of every point (N,), numbered from 0 in the order of `first`.

    Args:
        points: (N, D).
        weights: (N,).
        share: weight above which a point's cell is halved (N,).
        first: numbers of a point's first cell (N, C).
    """
    cell = torch.unique(first, dim=0, return_inverse=True)[1]
    for _ in range(_MAX_LEVELS):
        total, means, covariances = _moments(points, weights, None, cell)
        axis = torch.linalg.eigh(covariances)[1][..., -1]
        beyond = ((points - means[cell]) * axis[cell]).sum(1) > 0
        halves, cell = torch.unique(2 * cell + (beyond & (total[cell] > share)), return_inverse=True)
        if len(halves) == len(total):
            break
    return cell


def _moments(
    points: Tensor, weights: Tensor, spreads: Tensor | None, cell: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Weights (C,), means (C, D) and covariances (C, D, D) of the cells; sums run in the order of the points."""

    def sums(columns: Tensor) -> Tensor:
        return torch.stack([torch.bincount(cell, weights * column) for column in columns.unbind(1)], 1)

    total = torch.bincount(cell, weights)
    means = sums(points) / total[:, None]
    apart = points - means[cell]
    products = linalg.pack_symmetric(apart[:, :, None] * apart[:, None])
    if spreads is not None:
        products = products + linalg.pack_symmetric(spreads)
    return total, means, linalg.unpack_symmetric(sums(products) / total[:, None], points.shape[1])
