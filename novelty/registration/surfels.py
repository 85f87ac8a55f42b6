r"""Cells as pieces of surface: what their shape tells about a pose.

A cell is a patch of a surface: its thin direction says where the surface is, its long ones only where the cut of
the simplification fell. So long directions are made uninformative by

    A = S + S^3 / (x m)^2 + r^2 I,   m = (tr(S)^2 - tr(S^2)) / (2 tr(S)),

a matrix function of the spread S. m is close to the middle eigenvalue, so eigenvalues far below it stay as they are
and the two greater ones grow by 1 / x^2 or more: the plane-to-plane idea of generalized ICP (Segal, Haehnel & Thrun
2009) with the thickness measured instead of set, and without an eigendecomposition. A cell of one scan line has no
thin direction (its middle eigenvalue is as small as its least) and no say: lines of two scans must not lock on to
each other, which would be wrong by whole steps of the sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from gmmtorch import PointClouds

FLATNESS = 0.1
"""x: the ratio of a cell's least and middle variance below which it counts as flat."""

FLOOR = 0.02
"""r as a share of the cell's root-mean-square extent: no cell is thinner (exact planes)."""

MIN_POINTS = 5
"""Fewer points lie on a plane by chance."""


@dataclass(frozen=True, eq=False)
class Surfels:
    """Pieces of surface of P scans, packed, relative to one centre per scan.

    Attributes:
        means: (N, 3), m, relative to the centre of their pair.
        spreads: (N, 3, 3), m^2, S above.
        shapes: (N, 3, 3), m^2, A above.
        counts: (N,), points of the cell.
        extents: (N,), root-mean-square distance of a cell's points from its mean, m.
        thickness: (N,), standard deviation across the surface, m.
        owner: int64 (N,), pair of each.
        sizes: number of each pair's, (P,).
    """

    means: torch.Tensor
    spreads: torch.Tensor
    shapes: torch.Tensor
    counts: torch.Tensor
    extents: torch.Tensor
    thickness: torch.Tensor
    owner: torch.Tensor
    sizes: tuple[int, ...]

    def merged(self, limit: int) -> Surfels:
        """Coarser surfels: those of one voxel become one, about `limit` per scan; each counts alike.

        A flat cell of root-mean-square extent r is about 2.4 r wide, and surfaces fill squares of the voxel's side.
        """
        groups = len(self.sizes)
        medians = [
            part.median() if len(part) else part.new_ones(()) for part in self.extents.split(list(self.sizes))
        ]
        crowding = (torch.tensor(self.sizes) / limit).clamp_min(1)
        side = (2.4 * torch.stack(medians) * crowding.sqrt())[self.owner]
        places, members = _voxels(torch.floor(self.means / side[:, None]).long(), self.owner)
        owner = self.owner.new_zeros(places).index_copy_(0, members, self.owner)

        def summed(values: torch.Tensor) -> torch.Tensor:
            return values.new_zeros(places, *values.shape[1:]).index_add_(0, members, values)

        counts = summed(self.counts)
        means = summed(self.counts[:, None] * self.means) / counts[:, None]
        apart = self.means - means[members]
        second = self.spreads + apart[:, :, None] * apart[:, None, :]
        spreads = summed(self.counts[:, None, None] * second) / counts[:, None, None]
        return make_surfels(means, spreads, torch.ones_like(counts), owner, groups)


def _voxels(cells: torch.Tensor, owner: torch.Tensor) -> tuple[int, torch.Tensor]:
    """Number of different (pair, voxel), and which each of the voxel indices (N, 3) is, (N,)."""
    key = owner
    for axis in cells.unbind(1):
        # Ranks instead of the indices themselves: a far stray point must not make the key overflow.
        ranks = torch.unique(axis, return_inverse=True)[1]
        key = key * (len(cells) + 1) + ranks
        key = torch.unique(key, return_inverse=True)[1]
    return int(key.max()) + 1 if len(key) else 0, key


def make_surfels(
    means: torch.Tensor, spreads: torch.Tensor, counts: torch.Tensor, owner: torch.Tensor, groups: int
) -> Surfels:
    """Surfels from moments of the cells of `groups` scans; every spread has a positive trace."""
    variance = spreads.diagonal(dim1=1, dim2=2).sum(-1)
    shapes = _shapes(spreads, variance)
    return Surfels(
        means=means,
        spreads=spreads,
        shapes=shapes,
        counts=counts,
        extents=variance.sqrt(),
        thickness=information_trace(shapes).rsqrt(),
        owner=owner,
        sizes=tuple(torch.bincount(owner, minlength=groups).tolist()),
    )


def centres_of(points: torch.Tensor, sizes: Sequence[int]) -> torch.Tensor:
    """Mean of each of P packed clouds, (P, 3); 0 for an empty one."""
    return torch.stack(
        [part.mean(0) if len(part) else part.new_zeros(3) for part in points.split(list(sizes))]
    )


def surfels_of(cells: PointClouds, centres: torch.Tensor) -> Surfels:
    """The cells of every cloud that have a shape, relative to `centres` (P, 3).

    Args:
        cells: P clouds of cells with spreads.
        centres: (P, 3), m; taken off in float64, since maps may lie at 5e5 m.
    """
    assert cells.spreads is not None
    sizes = torch.tensor(cells.sizes)
    owner = torch.repeat_interleave(torch.arange(len(sizes)), sizes)
    variance = cells.spreads.diagonal(dim1=1, dim2=2).sum(-1)  # (N,)
    solid = torch.nonzero((cells.weights >= MIN_POINTS) & (variance > 0))[:, 0]
    owner = owner[solid]
    means = cells.points[solid] - centres[owner]
    return make_surfels(means, cells.spreads[solid], cells.weights[solid], owner, len(sizes))


def _shapes(spreads: torch.Tensor, variance: torch.Tensor) -> torch.Tensor:
    square = spreads @ spreads
    middle = (variance - square.diagonal(dim1=1, dim2=2).sum(-1) / variance) / 2  # (N,), 0 for an exact line
    scale = (FLATNESS * middle.clamp_min(FLOOR**2 * variance)).square()
    floor = FLOOR**2 * variance[:, None, None] * torch.eye(3, dtype=spreads.dtype)
    return spreads + square @ spreads / scale[:, None, None] + floor


def information_trace(shapes: torch.Tensor) -> torch.Tensor:
    """tr(A^-1), (N,), of symmetric positive shapes (N, 3, 3); for a patch, one over its variance across."""
    return torch.linalg.inv(shapes).diagonal(dim1=1, dim2=2).sum(-1)
