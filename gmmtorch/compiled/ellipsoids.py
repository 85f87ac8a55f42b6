"""Ellipsoids around the tiles, by which components that are far from a tile are told."""

from __future__ import annotations

import numpy as np
from numba import njit

from gmmtorch.compiled.mixtures import cholesky

__all__ = ["ellipsoids"]

Array = np.ndarray

_RIDGE = 1e-6  # of a tile's extent: the ellipsoid around a flat tile is a little thick


@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz", "nnan"}, cache=True)
def ellipsoids(local: Array, weights: Array) -> Array:
    """Packed matrices R of ellipsoids z^T R^-1 z <= 1 that hold the points of each tile (S, P), P = D (D + 1) / 2.

    R is the covariance of the tile about its centre, times the largest squared Mahalanobis distance of its points.

    Args:
        local: coordinates relative to the centre, 0 for padding (S, D, T).
        weights: 0 for padding (S, 1, T).
    """
    num_tiles, dim, length = local.shape
    reach = np.zeros((num_tiles, dim * (dim + 1) // 2))
    scatter, factor, first = np.zeros((1, 1, dim, dim)), np.zeros((dim, dim)), np.int64(0)
    white, squared = np.zeros((dim, length)), np.zeros(length)
    for g in range(num_tiles):
        real, trace, farthest = 0, 0.0, 0.0
        for t in range(length):
            real += 1 if weights[g, 0, t] > 0.0 else 0
        for i in range(dim):
            for j in range(i + 1):
                value = 0.0
                for t in range(length):
                    value += local[g, i, t] * local[g, j, t]
                scatter[0, 0, i, j] = scatter[0, 0, j, i] = value / max(real, 1)
            trace += scatter[0, 0, i, i]
        for i in range(dim):
            scatter[0, 0, i, i] += _RIDGE * trace
        if not cholesky(scatter, first, first, factor):
            continue  # one point: the ellipsoid is that point
        for t in range(length):
            squared[t] = 0.0
        for i in range(dim):
            for t in range(length):
                white[i, t] = local[g, i, t]
            for c in range(i):
                for t in range(length):
                    white[i, t] -= factor[i, c] * white[c, t]
            for t in range(length):
                white[i, t] /= factor[i, i]
                squared[t] += white[i, t] * white[i, t]
        for t in range(length):
            farthest = max(farthest, squared[t])
        place = 0
        for i in range(dim):
            for j in range(i, dim):
                reach[g, place] = farthest * scatter[0, 0, i, j]
                place += 1
    return reach
