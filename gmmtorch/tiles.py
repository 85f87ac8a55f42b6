"""How the points of a batch lie in memory: tiles of points that are near each other.

The points of a cloud are sorted along a space-filling curve and cut into tiles of T points; coordinates are kept
relative to the centre of their tile, so that float32 products lose nothing that matters. Every tile has an owner cloud,
so that one product serves clouds of any size. Padding points have weight 0.

The compiled loops of a CPU read the coordinates, and skip what is far from a tile by the ellipsoid around it. On a
device the lifted features phi(x) = [1, x_a, x_a x_b (a <= b)] are stored as well; a cell of points enters by the mean
of phi over it, which needs only its mean and its spread.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.clouds import PointClouds

__all__ = ["TILE", "Storage", "Tiles", "lift", "spatial_order"]

TILE = 128
"""Points of a tile: in larger ones more components matter, smaller ones cost more by the tile."""
_RIDGE = 1e-6  # of a tile's extent: the ellipsoid around a flat tile is a little thick
_LONG_RUN = 1024  # tiles, 131 072 points: a device takes as long to launch their products as to make them
_UNIT = 16  # tiles whose moments are added up in one place, by one thread


@dataclass(frozen=True)
class Storage:
    """The points of all clouds, tile after tile.

    Attributes:
        local: coordinates relative to the tile's centre, 0 for padding (S, D, T) float64.
        spreads: packed spreads of cells (S, D (D + 1) / 2, T) float64, or None.
        weights: point weights, 0 for padding (S, 1, T) float64.
        centers: tile centres (S, D) float64.
        dtype: precision of the arithmetic.
    """

    local: Tensor
    spreads: Tensor | None
    weights: Tensor
    centers: Tensor
    dtype: torch.dtype

    def take(self, rows: Tensor) -> Storage:
        """Copy these tiles (S',) int64."""
        spreads = None if self.spreads is None else self.spreads[rows]
        return Storage(self.local[rows], spreads, self.weights[rows], self.centers[rows], self.dtype)

    @cached_property
    def features(self) -> Tensor:
        """Phi of every point (S, F, T) in the arithmetic's precision: what the tensor operations read."""
        return lift(self.local, self.spreads, self.dtype)

    @cached_property
    def in_double(self) -> Storage:
        """The same points for arithmetic in float64."""
        return self if self.dtype == torch.float64 else replace(self, dtype=torch.float64)

    @cached_property
    def reach(self) -> Tensor:
        """Packed R of an ellipsoid z^T R^-1 z <= 1 about each centre that holds the points (S, D (D + 1) / 2)."""
        real = (self.weights > 0).sum(-1, keepdim=True).clamp_min(1)  # (S, 1, 1)
        scatter = torch.bmm(self.local, self.local.transpose(1, 2)) / real
        extent = scatter.diagonal(dim1=1, dim2=2).sum(-1)[:, None, None]
        ridge = torch.where(extent > 0, _RIDGE * extent, 1.0)  # a tile of one point has no extent
        scatter = scatter + ridge * torch.eye(self.local.shape[1], dtype=scatter.dtype)
        white = torch.linalg.solve_triangular(torch.linalg.cholesky(scatter), self.local, upper=False)
        farthest = white.square().sum(1).amax(1, keepdim=True)  # (S, 1)
        return linalg.pack_symmetric(scatter) * farthest * (1.0 + _RIDGE)


@dataclass(frozen=True)
class Tiles:
    """A batch of clouds as G tiles: cloud b is counts[b] tiles of the storage, from first[b] on.

    A cloud may stand in the batch several times, with as many mixtures, without its points being copied.
    """

    storage: Storage
    first: tuple[int, ...]
    counts: tuple[int, ...]

    @staticmethod
    def build(clouds: PointClouds) -> Tiles:
        """Sort, cut and lift a batch of normalised clouds."""
        counts = tuple(-(-n // TILE) for n in clouds.sizes)
        source, real = _tile_sources(clouds, counts)
        points = clouds.points[source]  # (G, T, D)
        mask = real[..., None]
        centers = torch.where(mask, points, 0.0).sum(1) / real.sum(1, keepdim=True).clamp_min(1)
        local = torch.where(mask, points - centers[:, None], 0.0).transpose(1, 2).contiguous()  # (G, D, T)
        spreads = None
        if clouds.spreads is not None:
            packed = linalg.pack_symmetric(clouds.spreads)[source]  # (G, T, D (D + 1) / 2)
            spreads = torch.where(mask, packed, 0.0).transpose(1, 2).contiguous()
        weights = torch.where(real, clouds.weights[source], 0.0)[:, None]
        storage = Storage(local, spreads, weights, centers, clouds.dtype)
        return Tiles(storage, _starts(counts), counts)._in_long_runs()

    def take(self, clouds: Sequence[int]) -> Tiles:
        """The batch of these clouds (B',), known on the host, in this order; a cloud may repeat."""
        picked = Tiles(
            self.storage, tuple(self.first[b] for b in clouds), tuple(self.counts[b] for b in clouds)
        )
        return picked._in_long_runs()

    @property
    def in_double(self) -> Tiles:
        """The same batch for arithmetic in float64."""
        return Tiles(self.storage.in_double, self.first, self.counts)

    @property
    def batch_size(self) -> int:
        """Number of clouds B."""
        return len(self.counts)

    @property
    def dtype(self) -> torch.dtype:
        """Precision of the arithmetic."""
        return self.storage.dtype

    @property
    def on_cpu(self) -> bool:
        """Whether the compiled loops can read the points."""
        return self.storage.local.device.type == "cpu"

    @cached_property
    def units(self) -> tuple[NDArray[np.int64], ...]:
        """Stretches of at most 16 tiles of one cloud, whose moments are added up by one thread.

        The cloud of every unit (U,), its first tile in the storage and the one after its last (U,), and the first unit
        of every cloud (B + 1,).
        """
        pieces = np.array([-(-count // _UNIT) for count in self.counts], np.int64)
        offsets = np.concatenate([[0], pieces.cumsum()])
        owners = np.repeat(np.arange(len(pieces)), pieces)
        steps = _UNIT * (np.arange(len(owners)) - offsets[owners])
        first, counts = (np.array(numbers, np.int64)[owners] for numbers in (self.first, self.counts))
        return owners, first + steps, first + np.minimum(steps + _UNIT, counts), offsets

    @cached_property
    def owner(self) -> Tensor:
        """Cloud of every tile (G,) int64."""
        return _owners(self.counts, self.storage.centers.device)

    @cached_property
    def starts(self) -> Tensor:
        """First tile of every cloud (B,) int64."""
        return torch.tensor(_starts(self.counts), device=self.storage.centers.device)

    @cached_property
    def centers(self) -> Tensor:
        """Tile centres (G, D) float64."""
        parts = [self.storage.centers[start : start + length] for _, start, length in self.runs]
        return torch.cat(parts) if parts else self.storage.centers[:0]

    @cached_property
    def runs(self) -> tuple[tuple[int, int, int], ...]:
        """Stretches of tiles that lie one after the other in the storage: (tile, place in the storage, length)."""
        runs: list[tuple[int, int, int]] = []
        for tile, start, length in zip(_starts(self.counts), self.first, self.counts, strict=True):
            if length and runs and runs[-1][1] + runs[-1][2] == start:
                runs[-1] = (*runs[-1][:2], runs[-1][2] + length)
            elif length:
                runs.append((tile, start, length))
        return tuple(runs)

    def _in_long_runs(self) -> Tiles:
        """Copy the tiles one after the other where runs are short, and add an empty tile to a single one.

        On a device every run costs launches. And the BLAS rounds a product of one matrix unlike one of several;
        without such products, the result of a cloud depends less on the others. The compiled loops of a CPU have no
        such needs.
        """
        total = sum(self.counts)
        if self.on_cpu or all(length >= max(2, min(total, _LONG_RUN)) for _, _, length in self.runs):
            return self
        device = self.storage.centers.device
        rows = torch.cat([torch.arange(start, start + length) for _, start, length in self.runs]).to(device)
        if total > 1:
            return Tiles(self.storage.take(rows), _starts(self.counts), self.counts)
        storage = self.storage.take(rows.expand(2))
        storage.weights[1] = 0.0
        counts = tuple(2 * count for count in self.counts)
        return Tiles(storage, _starts(counts), counts)


def lift(local: Tensor, spreads: Tensor | None, dtype: torch.dtype) -> Tensor:
    """Lift to phi = [1, x_a, x_a x_b + S_ab (a <= b)], the mean of the features over a cell: (G, D, T) -> (G, F, T)."""
    dim = local.shape[1]
    features = local.new_empty(local.shape[0], linalg.num_lifted(dim), local.shape[2], dtype=dtype)
    features[:, 0] = 1.0
    features[:, 1 : 1 + dim] = local
    for i, (a, b) in enumerate(zip(*linalg.triangle(dim), strict=True)):
        product = local[:, a] * local[:, b]
        features[:, 1 + dim + i] = product if spreads is None else product + spreads[:, i]
    return features


def _starts(counts: Sequence[int]) -> tuple[int, ...]:
    """Running total of the counts before each one."""
    return tuple(itertools.accumulate(counts, initial=0))[:-1]


def _owners(counts: Sequence[int], device: torch.device) -> Tensor:
    """Index b repeated counts[b] times (G,) int64."""
    return torch.repeat_interleave(torch.tensor(counts, device=device), output_size=sum(counts))


def _tile_sources(clouds: PointClouds, counts: Sequence[int]) -> tuple[Tensor, Tensor]:
    """Point that fills each place of each tile (G, T) int64, and whether it is one, not padding (G, T) bool."""
    order = spatial_order(clouds)
    device = clouds.device
    owner = _owners(counts, device)
    first_tile = torch.tensor(_starts(counts), device=device)[owner]
    rank = (torch.arange(owner.shape[0], device=device) - first_tile)[:, None] * TILE
    rank = rank + torch.arange(TILE, device=device)
    sizes = torch.tensor(clouds.sizes, device=device)[owner, None]
    starts = torch.tensor(clouds.offsets[:-1], device=device)[owner, None]
    return order[starts + torch.minimum(rank, sizes - 1)], rank < sizes


def spatial_order(clouds: PointClouds) -> Tensor:
    """Order of the points along a Morton curve within each cloud (N,) int64.

    x / (1 + |x|) brings the whole line into (-1, 1), so that one far outlier does not flatten the curve.
    """
    dim = clouds.dim
    bits = min(10, 40 // dim)
    unit = clouds.points / (1.0 + clouds.points.abs())
    cells = ((unit + 1.0) * (0.5 * 2**bits)).long().clamp_(0, 2**bits - 1)  # (N, D)
    codes = torch.arange(2**bits, device=clouds.device)
    spread = torch.stack([((codes >> i) & 1) << (i * dim) for i in range(bits)]).sum(0)
    key = clouds.cloud_index << 40
    for a in range(dim):
        key = key + (spread[cells[:, a]] << a)
    return torch.sort(key, stable=True).indices
