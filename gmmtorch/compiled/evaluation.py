"""Mixtures at the points of their clouds, in their order: what `gmmtorch.evaluation` gives, by a compiled loop."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import torch
from numba import njit
from torch import Tensor

from gmmtorch.clouds import PointClouds
from gmmtorch.compiled.arithmetic import exp, log
from gmmtorch.compiled.mixtures import describe
from gmmtorch.compiled.points import MEAN, place_center, whiten
from gmmtorch.compiled.threads import shared_out
from gmmtorch.tiles import TILE

__all__ = ["Evaluation", "evaluate"]

Array = np.ndarray

_LOWEST = -700.0  # where exp leaves the normal numbers; a responsibility below exp of it is 0
_NOBODY = -1e29  # a log-density below: the mixture is empty
_FAST = {"contract", "nsz"}


@dataclass(frozen=True)
class Evaluation:
    """What was asked for of every point; what was not is empty.

    Attributes:
        log_prob: log p(x_n) (N,) float64, nats; -inf where the mixture is empty, NaN where the point is not finite.
        responsibilities: r_nk, component by component (K, N) float64; 0 or NaN there.
        components: argmax_k r_nk (N,) int64; -1 there.
        counts: sum_n w_n r_nk (B, K) float64.
    """

    log_prob: Tensor
    responsibilities: Tensor
    components: Tensor
    counts: Tensor


def evaluate(
    weights: Tensor, means: Tensor, factors: Tensor, clouds: PointClouds, *,
    log_prob: bool = False, responsibilities: bool = False, components: bool = False, counts: bool = False,
) -> Evaluation:  # fmt: skip
    """Evaluate the mixture of every cloud at its points.

    Args:
        weights: pi_k (B, K), 0 for padding.
        means: mu_k (B, K, D).
        factors: lower Cholesky factors of the covariances (B, K, D, D).
        clouds: the points.
        log_prob: whether to give the log-densities.
        responsibilities: whether to give them.
        components: whether to give the most likely ones.
        counts: whether to give the expected counts.
    """
    num_points, batch, num_components = len(clouds.points), clouds.batch_size, weights.shape[1]
    packed = clouds.dim * (clouds.dim + 1) // 2
    form = np.empty((batch, MEAN + clouds.dim + 2 * packed, num_components))
    parameters = (np.ascontiguousarray(t.numpy()) for t in (weights, means, factors))
    describe(np.arange(batch), *parameters, np.zeros(batch), form)
    owners, starts = _blocks(clouds)
    stops = np.append(starts[1:], num_points)
    spreads = np.empty((0, clouds.dim, clouds.dim))
    if clouds.spreads is not None:
        spreads = np.ascontiguousarray(clouds.spreads.numpy())
    found = (
        np.empty(num_points if log_prob else 0),
        np.empty((num_components, num_points if responsibilities else 0)),
        np.empty(num_points if components else 0, np.int64),
        np.empty((len(starts) if counts else 0, num_components)),
    )
    points, mass = (np.ascontiguousarray(t.numpy()) for t in (clouds.points, clouds.weights))

    def share(first: int, last: int) -> None:
        _evaluate_blocks(first, last, owners, starts, stops, points, spreads, mass, form, *found)

    shared_out(share, len(starts), num_points * num_components)
    summed = np.zeros((batch, num_components))
    if counts:
        np.add.at(summed, owners, found[3])
    first, second, third = (torch.from_numpy(values) for values in found[:3])
    return Evaluation(first, second, third, torch.from_numpy(summed))


def _blocks(clouds: PointClouds) -> tuple[Array, Array]:
    """Cloud and first point of every block of at most T consecutive points."""
    starts = [np.arange(first, last, TILE) for first, last in itertools.pairwise(clouds.offsets)]
    owners = np.repeat(np.arange(clouds.batch_size), [len(s) for s in starts])
    return owners, np.concatenate(starts).astype(np.int64)


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _evaluate_blocks(
    first: int, last: int, owners: Array, starts: Array, stops: Array,
    points: Array, spreads: Array, weights: Array, form: Array,
    log_prob: Array, responsibilities: Array, components: Array, counts: Array,
) -> None:  # fmt: skip
    """Evaluate the blocks from first to last."""
    dim, num_components = points.shape[1], form.shape[2]
    x, spread = np.zeros((dim, TILE)), np.zeros((dim * (dim + 1) // 2, TILE))
    y, logits = np.empty((dim * num_components, TILE)), np.empty((num_components, TILE))
    peak: Array = np.empty(TILE)
    total: Array = np.empty(TILE)
    valid: Array = np.empty(TILE)
    best: Array = np.empty(TILE, np.int64)
    offsets, squared, numbers = np.empty((dim, num_components)), np.empty(num_components), np.empty(10)
    sums = len(log_prob) > 0 or responsibilities.shape[1] > 0 or len(counts) > 0
    for g in range(first, last):
        b, start = owners[g], starts[g]
        size = stops[g] - start
        center = _load(start, size, points, spreads, x, spread, valid)
        place_center(center, b, points, form, offsets, squared)
        for t in range(TILE):
            peak[t], best[t] = -np.inf, -1
        for k in range(num_components):
            whiten(k, b, k, form, offsets, numbers, x, spread, len(spreads) > 0, y, logits)
            for t in range(TILE):
                best[t] = k if logits[k, t] > peak[t] else best[t]
                peak[t] = max(logits[k, t], peak[t])
        if sums:
            _exponentiate(logits, peak, total)
        if len(components):
            for t in range(size):
                components[start + t] = best[t] if peak[t] > _NOBODY and valid[t] == 1.0 else -1
        if len(log_prob):
            for t in range(size):
                log_prob[start + t] = (peak[t] + log(total[t]) if total[t] > 0.0 else -np.inf) * valid[t]
        for t in range(size):
            total[t] = valid[t] / total[t] if total[t] > 0.0 else 0.0 * valid[t]
        for k in range(num_components):
            if responsibilities.shape[1]:
                for t in range(size):
                    responsibilities[k, start + t] = logits[k, t] * total[t]
            if len(counts):
                counts[g, k] = 0.0
                for t in range(size):
                    counts[g, k] += weights[start + t] * logits[k, t] * total[t]


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _load(start: int, size: int, points: Array, spreads: Array, x: Array, spread: Array, valid: Array) -> int:
    """Coordinates relative to the block's first finite point, whose number is returned; `valid` is 1 or NaN."""
    dim, center = points.shape[1], start
    for t in range(size - 1, -1, -1):
        valid[t] = 1.0
        for a in range(dim):
            valid[t] = valid[t] if np.isfinite(points[start + t, a]) else np.nan
        center = start + t if valid[t] == 1.0 else center
    place = 0
    for a in range(dim if len(spreads) else 0):
        for c in range(a, dim):
            for t in range(size):
                value = spreads[start + t, a, c]
                valid[t] = valid[t] if np.isfinite(value) else np.nan
                spread[place, t] = value if np.isfinite(value) else 0.0
            place += 1
    for a in range(dim):
        for t in range(size):
            x[a, t] = points[start + t, a] - points[center, a] if valid[t] == 1.0 else 0.0
    return center


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _exponentiate(logits: Array, peak: Array, total: Array) -> None:
    """Likelihoods relative to the peak in the place of the logits, and their sums; 0 where the mixture is empty."""
    for t in range(TILE):
        total[t] = 0.0
    for k in range(len(logits)):
        largest = -np.inf
        for t in range(TILE):
            largest = max(largest, logits[k, t] - peak[t])
        if not largest > _LOWEST:
            for t in range(TILE):
                logits[k, t] = 0.0
            continue
        for t in range(TILE):
            away = logits[k, t] - peak[t]
            likelihood = exp(max(away, _LOWEST))
            logits[k, t] = likelihood if away > _LOWEST and peak[t] > _NOBODY else 0.0
            total[t] += logits[k, t]
