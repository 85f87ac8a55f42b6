"""A batch of mixtures and their clouds as arrays for the compiled loops, and the E-step of its clouds over threads."""

from __future__ import annotations

import numpy as np
import torch

from gmmtorch.compiled.mixtures import collect, describe
from gmmtorch.compiled.points import MEAN, pass_over_points
from gmmtorch.compiled.threads import shared_out
from gmmtorch.components import Components
from gmmtorch.linalg import num_lifted
from gmmtorch.tiles import TILE, Tiles

__all__ = ["Batch", "Parameters"]

Array = np.ndarray


class Parameters:
    """Weights (B, K), means (B, K, D), covariances and Cholesky factors (B, K, D, D) of a batch, to be overwritten."""

    def __init__(self, components: Components) -> None:
        tensors = (components.weights, components.means, components.covariances, components.factors)
        self.arrays = tuple(np.array(t.numpy(), order="C") for t in tensors)
        self.weights, self.means, self.covariances, self.factors = self.arrays

    def components(self) -> Components:
        """The same as tensors that share these arrays."""
        return Components(*(torch.from_numpy(a) for a in self.arrays))


class Batch:
    """The points of a batch, and room for what a pass over them gives."""

    def __init__(self, tiles: Tiles, floor: Array, num_components: int, precision: torch.dtype) -> None:
        storage = tiles.storage
        dim = storage.local.shape[1]
        packed = dim * (dim + 1) // 2
        spreads = (
            torch.zeros(0, packed, TILE, dtype=torch.float64) if storage.spreads is None else storage.spreads
        )
        self.floor = floor
        self.owners, self.starts, self.stops, self.unit_offsets = tiles.units
        self.points = tuple(
            t.numpy() for t in (storage.local, spreads, storage.weights, storage.centers, storage.reach)
        )
        num_moments = num_lifted(dim) + (packed if len(spreads) else 0)
        self.form = np.empty((tiles.batch_size, MEAN + dim + 2 * packed, num_components))
        self.moments = np.empty((len(self.owners), num_components, num_moments))
        self.values = np.empty((len(self.owners), 2))
        self.precision = np.zeros(1, np.float32 if precision == torch.float32 else np.float64)

    def expect(self, clouds: Array, mixtures: Parameters, statistics: Array, totals: Array) -> None:
        """E-step of these clouds (B',) int64: statistics (B, K, M), objectives and log-likelihoods (B, 2), nats."""
        describe(clouds, mixtures.weights, mixtures.means, mixtures.factors, self.floor, self.form)
        self._pass(self._units_of(clouds))
        collect(clouds, self.unit_offsets, self.moments, self.values, mixtures.factors, statistics, totals)

    def _units_of(self, clouds: Array) -> Array:
        if len(clouds) == len(self.unit_offsets) - 1:
            return np.arange(len(self.owners))
        pieces = [np.arange(self.unit_offsets[b], self.unit_offsets[b + 1]) for b in clouds]
        return np.concatenate(pieces)

    def _pass(self, units: Array) -> None:
        """Pass the points of these units; no bit depends on the number of threads."""

        def share(first: int, last: int) -> None:
            pass_over_points(
                units, first, last, self.owners, self.starts, self.stops, *self.points,
                self.form, self.moments, self.values, self.precision,
            )  # fmt: skip

        work = int((self.stops - self.starts)[units].sum()) * TILE * self.form.shape[2]
        shared_out(share, len(units), work)
