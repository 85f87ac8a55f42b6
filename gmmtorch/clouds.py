"""A batch of point clouds of any sizes, packed into one tensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from gmmtorch.errors import ArgumentError, ShapeError

__all__ = ["ArrayLike", "PointClouds"]

ArrayLike = Tensor | np.ndarray
_ARITHMETIC = (torch.float32, torch.float64)


@dataclass(frozen=True, eq=False)
class PointClouds:
    """B point clouds, or clouds of cells, one after the other in memory.

    A *cell* stands for several points: its weight is their number, its point their mean, its spread their
    covariance. A raw point is a cell of weight 1 and no spread. Coordinates stay in float64, as given: maps live
    5e5 m from their origin. `dtype` is the precision of the arithmetic, used after centring and scaling.

    Attributes:
        points: packed coordinates (N, D) float64, m.
        weights: weight of every point, its number of original points (N,) float64.
        spreads: covariance inside every cell (N, D, D) float64, m^2; None for raw points.
        offsets: host-known bounds (B + 1,): cloud b is `points[offsets[b]:offsets[b + 1]]`.
        dtype: precision of the fit, `torch.float64` or `torch.float32`.

    Example:
        >>> clouds = PointClouds.from_list([np.zeros((4, 3)), np.ones((2, 3))])
        >>> clouds.batch_size, clouds.sizes
        (2, (4, 2))
    """

    points: Tensor
    weights: Tensor
    spreads: Tensor | None
    offsets: tuple[int, ...]
    dtype: torch.dtype = torch.float64

    @staticmethod
    def from_list(
        points: Sequence[ArrayLike],
        weights: Sequence[ArrayLike] | None = None,
        spreads: Sequence[ArrayLike] | None = None,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str | None = None,
    ) -> PointClouds:
        """Pack a list of clouds; copies, so that later changes to the inputs have no effect.

        Args:
            points: B arrays or tensors (N_b, D), m; N_b may be 0.
            weights: B arrays (N_b,), >= 0; ones by default.
            spreads: B arrays (N_b, D, D), m^2; no spread by default.
            dtype: precision of the arithmetic, float64 or float32.
            device: where the batch lives; by default where the first tensor is.

        Raises:
            ShapeError: if the list is empty or a shape does not fit.
            ArgumentError: if `dtype` is unknown or a weight is negative.
        """
        if len(points) == 0:
            raise ShapeError("expected at least one cloud, got an empty list; pass [x] for a single cloud")
        if dtype not in _ARITHMETIC:
            raise ArgumentError(f"dtype must be torch.float64 or torch.float32, got {dtype}")
        if device is None:
            device = points[0].device if isinstance(points[0], Tensor) else torch.device("cpu")
        packed = [_as_float64(x, device) for x in points]
        dim = _common_dim(packed)
        sizes = [x.shape[0] for x in packed]
        offsets = (0, *np.cumsum(sizes).tolist())
        return PointClouds(
            points=torch.cat(packed),
            weights=_pack_weights(weights, sizes, device),
            spreads=_pack_spreads(spreads, sizes, dim, device),
            offsets=offsets,
            dtype=dtype,
        )

    @property
    def batch_size(self) -> int:
        """Number of clouds B."""
        return len(self.offsets) - 1

    @property
    def dim(self) -> int:
        """Number of coordinates D."""
        return self.points.shape[1]

    @property
    def device(self) -> torch.device:
        """Device of all tensors."""
        return self.points.device

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Number of points of every cloud (B,), known on the host."""
        return tuple(b - a for a, b in zip(self.offsets[:-1], self.offsets[1:], strict=True))

    @cached_property
    def cloud_index(self) -> Tensor:
        """Cloud of every point, b with offsets[b] <= n < offsets[b + 1] (N,) int64."""
        sizes = torch.tensor(self.sizes, device=self.device)
        return torch.repeat_interleave(sizes, output_size=self.offsets[-1])

    @cached_property
    def total_weights(self) -> Tensor:
        """Total weight of every cloud, its number of original points (B,) float64."""
        return torch.stack([w.sum() for w in self.split(self.weights)])

    def __len__(self) -> int:
        """Number of clouds B."""
        return self.batch_size

    def __getitem__(self, index: int) -> PointClouds:
        """Return cloud `index` as a batch of one."""
        return self.select([index])

    def split(self, values: Tensor) -> tuple[Tensor, ...]:
        """Cut a packed tensor (N, ...) into one view per cloud (N_b, ...)."""
        if values.shape[:1] != self.points.shape[:1]:
            raise ShapeError(
                f"expected {self.points.shape[0]} rows, one per point, got {tuple(values.shape)}"
            )
        return torch.split(values, list(self.sizes))

    def select(self, indices: Sequence[int]) -> PointClouds:
        """Return the clouds of these indices, in this order; an index may repeat."""
        if len(indices) == 0:
            raise ArgumentError("select needs at least one index, got none")
        members = [range(self.batch_size)[i] for i in indices]

        def gather(values: Tensor) -> Tensor:
            parts = self.split(values)
            return torch.cat([parts[b] for b in members])

        return PointClouds(
            points=gather(self.points),
            weights=gather(self.weights),
            spreads=None if self.spreads is None else gather(self.spreads),
            offsets=(0, *np.cumsum([self.sizes[b] for b in members]).tolist()),
            dtype=self.dtype,
        )

    @staticmethod
    def concatenate(batches: Sequence[PointClouds]) -> PointClouds:
        """Return the clouds of several batches as one, in order; zero spreads fill in where only some have any.

        Raises:
            ShapeError: if the list is empty or the batches differ in the number of coordinates.
        """
        if len(batches) == 0:
            raise ShapeError("expected at least one batch to concatenate, got an empty list")
        dim = _common_dim([batch.points for batch in batches])
        with_spreads = any(batch.spreads is not None for batch in batches)

        def spreads_of(batch: PointClouds) -> Tensor:
            zero = batch.points.new_zeros(batch.points.shape[0], dim, dim)
            return zero if batch.spreads is None else batch.spreads

        return PointClouds(
            points=torch.cat([batch.points for batch in batches]),
            weights=torch.cat([batch.weights for batch in batches]),
            spreads=torch.cat([spreads_of(batch) for batch in batches]) if with_spreads else None,
            offsets=(0, *np.cumsum([size for batch in batches for size in batch.sizes]).tolist()),
            dtype=batches[0].dtype,
        )

    def centroids(self) -> PointClouds:
        """Return the cells' means alone, each a point of weight 1 without spread (the paper's reading of a cell)."""
        return PointClouds(
            points=self.points,
            weights=torch.ones_like(self.weights),
            spreads=None,
            offsets=self.offsets,
            dtype=self.dtype,
        )

    def to(self, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> PointClouds:
        """Return the batch on another device, or with another precision of the arithmetic."""
        if dtype is not None and dtype not in _ARITHMETIC:
            raise ArgumentError(f"dtype must be torch.float64 or torch.float32, got {dtype}")
        device = self.device if device is None else device
        return PointClouds(
            points=self.points.to(device),
            weights=self.weights.to(device),
            spreads=None if self.spreads is None else self.spreads.to(device),
            offsets=self.offsets,
            dtype=dtype or self.dtype,
        )


def _as_float64(values: ArrayLike, device: torch.device | str) -> Tensor:
    """Copy an array or tensor to float64 on a device."""
    tensor = torch.as_tensor(values)
    if tensor.is_complex():
        raise ArgumentError("points, weights and spreads must be real numbers, got complex ones")
    return tensor.detach().to(device=device, dtype=torch.float64)


def _common_dim(packed: list[Tensor]) -> int:
    """Return the number of coordinates D that all clouds share."""
    for b, x in enumerate(packed):
        if x.ndim != 2 or x.shape[1] == 0:
            raise ShapeError(f"cloud {b}: expected points of shape (N, D), got {tuple(x.shape)}")
        if x.shape[1] != packed[0].shape[1]:
            raise ShapeError(
                f"cloud {b} has {x.shape[1]} coordinates and cloud 0 has {packed[0].shape[1]}; "
                "clouds of one batch need the same number"
            )
    return packed[0].shape[1]


def _pack_weights(
    weights: Sequence[ArrayLike] | None, sizes: list[int], device: torch.device | str
) -> Tensor:
    """Pack and check the weights (N,); ones by default."""
    if weights is None:
        return torch.ones(sum(sizes), dtype=torch.float64, device=device)
    packed = _pack(weights, [(n,) for n in sizes], "weights", device)
    if bool((packed < 0).any()):
        raise ArgumentError(f"weights must be >= 0, got {packed.min().item():g}")
    return packed


def _pack_spreads(
    spreads: Sequence[ArrayLike] | None, sizes: list[int], dim: int, device: torch.device | str
) -> Tensor | None:
    """Pack the spreads (N, D, D), made exactly symmetric."""
    if spreads is None:
        return None
    packed = _pack(spreads, [(n, dim, dim) for n in sizes], "spreads", device)
    return 0.5 * (packed + packed.transpose(1, 2))


def _pack(
    values: Sequence[ArrayLike], shapes: Sequence[tuple[int, ...]], name: str, device: torch.device | str
) -> Tensor:
    """Check the shape of every array of a list and concatenate them."""
    if len(values) != len(shapes):
        raise ShapeError(f"expected {len(shapes)} arrays of {name}, one per cloud, got {len(values)}")
    packed = [_as_float64(v, device) for v in values]
    for b, (v, shape) in enumerate(zip(packed, shapes, strict=True)):
        if tuple(v.shape) != shape:
            raise ShapeError(f"cloud {b}: expected {name} of shape {shape}, got {tuple(v.shape)}")
    return torch.cat(packed)
