"""Resize on a CPU: what `gmmtorch.merging` does, cloud by cloud, in place."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from torch import Tensor

from gmmtorch.compiled.batch import Parameters
from gmmtorch.compiled.mixtures import cholesky
from gmmtorch.components import Components

__all__ = ["merge_closest_pair"]

Array = np.ndarray


def merge_closest_pair(components: Components, total: Tensor, clouds: Tensor) -> Components:
    """Replace the pair of least d(l, m) (eq. 7) by its moment-matched union; see `gmmtorch.merging`."""
    mixtures = Parameters(components)
    _merge(np.flatnonzero(clouds.numpy()), total.numpy(), *mixtures.arrays)
    return mixtures.components()


@njit(nogil=True, error_model="numpy", cache=True)
def _merge(
    clouds: Array, total: Array, weights: Array, means: Array, covariances: Array, factors: Array
) -> None:
    num_components, dim = means.shape[1], means.shape[2]
    zero: Any = np.int64(0)  # a literal 0 would compile what it is given to twice
    union, factor = np.zeros((1, 1, dim, dim)), np.zeros((1, 1, dim, dim))
    log_dets = np.zeros(num_components)
    for b in clouds:
        for k in range(num_components):
            log_dets[k] = _log_determinant(factors, b, k)
        least, left, right = np.inf, zero, zero
        for i in range(num_components):
            for j in range(i + 1, num_components):
                if not (weights[b, i] > 0.0 and weights[b, j] > 0.0):
                    continue
                _unite(b, i, j, weights, means, covariances, union)
                joint = (
                    _log_determinant(factor, zero, zero) if cholesky(union, zero, zero, factor[0, 0]) else 0.0
                )
                distance = weights[b, i] * (joint - log_dets[i]) + weights[b, j] * (joint - log_dets[j])
                if 0.5 * total[b] * distance < least:
                    least, left, right = 0.5 * total[b] * distance, i, j
        if left < right:
            _replace(b, left, right, weights, means, covariances, factors, union, factor)


@njit(nogil=True, error_model="numpy", cache=True)
def _log_determinant(factors: Array, b: int, k: int) -> float:
    value = 0.0
    for i in range(factors.shape[2]):
        value += 2.0 * math.log(factors[b, k, i, i])
    return value


@njit(nogil=True, error_model="numpy", cache=True)
def _unite(b: int, i: int, j: int, weights: Array, means: Array, covariances: Array, union: Array) -> None:
    """Covariance of the union of components i and j of cloud b, into union[0, 0]."""
    dim = means.shape[2]
    share = weights[b, j] / (weights[b, i] + weights[b, j])
    for a in range(dim):
        for c in range(dim):
            apart = (means[b, j, a] - means[b, i, a]) * (means[b, j, c] - means[b, i, c])
            within = (1.0 - share) * covariances[b, i, a, c] + share * covariances[b, j, a, c]
            union[0, 0, a, c] = within + share * (1.0 - share) * apart


@njit(nogil=True, error_model="numpy", cache=True)
def _replace(
    b: int, kept: int, gone: int, weights: Array, means: Array, covariances: Array, factors: Array,
    union: Array, factor: Array,
) -> None:  # fmt: skip
    """Put the union in the slot `kept`; a union without a Cholesky factor leaves no component there."""
    dim = means.shape[2]
    zero: Any = np.int64(0)
    _unite(b, kept, gone, weights, means, covariances, union)
    positive = cholesky(union, zero, zero, factor[0, 0])
    share = weights[b, gone] / (weights[b, kept] + weights[b, gone])
    weights[b, kept] = weights[b, kept] + weights[b, gone] if positive else 0.0
    weights[b, gone] = 0.0
    for a in range(dim):
        means[b, kept, a] += share * (means[b, gone, a] - means[b, kept, a])
        for c in range(dim):
            covariances[b, kept, a, c] = union[0, 0, a, c]
            factors[b, kept, a, c] = factor[0, 0, a, c]
    for slot in (kept, gone):
        if weights[b, slot] == 0.0:
            for a in range(dim):
                means[b, slot, a] = 0.0
                for c in range(dim):
                    covariances[b, slot, a, c] = factors[b, slot, a, c] = 1.0 if a == c else 0.0
    whole = 0.0
    for k in range(weights.shape[1]):
        whole += weights[b, k]
    for k in range(weights.shape[1]):
        weights[b, k] /= whole if whole > 0.0 else 1.0
