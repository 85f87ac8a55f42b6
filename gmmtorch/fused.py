"""The pass over the points on a CPU as one compiled loop (Numba): logits, softmax and moments while they are in L1.

The same arithmetic as the two products of `gmmtorch.statistics`, tile by tile, in blocks of 128 points. Points that lie
together are close to few components: a component whose logit is everywhere in a block 60 nats below the largest has
responsibilities below 1e-26 there, and the rest of its work, three quarters of all, is left out. Tiles are
independent of each other, so that threads change nothing in the result, not even its last bit.

On a device, `gmmtorch.statistics` makes the same pass by tensor operations.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numba import njit  # type: ignore[import-not-found,import-untyped,unused-ignore]
from numba.extending import overload  # type: ignore[import-not-found,import-untyped,unused-ignore]
from torch import Tensor

__all__ = ["moments_of_tiles"]

Array = np.ndarray

_BLOCK = 128  # divides the tile; the logits of a block stay in the first-level cache
_FLOOR = -60.0
_SPLIT_ABOVE = 1 << 17  # points times components: below, a second thread costs more than it saves
_FAST = {
    "reassoc",
    "contract",
    "nsz",
    "nnan",
}  # sums may be reordered into vector lanes; there are no NaNs


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def _exp(x: Any) -> Any:
    """Exp of x in [-700, 0], to 2e-16 relative; branch-free, so that loops over it become vector code."""
    n = np.int32(x * 1.4426950408889634 - 0.5)
    r = x - n * 0.693147180369123816490
    r = r - n * 1.90821492927058770002e-10
    p = 1 / 479001600.0
    p = p * r + 1 / 39916800.0
    p = p * r + 1 / 3628800.0
    p = p * r + 1 / 362880.0
    p = p * r + 1 / 40320.0
    p = p * r + 1 / 5040.0
    p = p * r + 1 / 720.0
    p = p * r + 1 / 120.0
    p = p * r + 1 / 24.0
    p = p * r + 1 / 6.0
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    return p * np.int64((np.int64(n) + 1023) << 52).view(np.float64)


_LOG2_E, _LN2_HIGH, _LN2_LOW, _HALF, _ONE = (
    np.float32(v) for v in (1.4426950408889634, 0.693359375, -2.12194440e-4, 0.5, 1.0)
)
_F7, _F6, _F5, _F4, _F3 = (np.float32(1 / v) for v in (5040, 720, 120, 24, 6))
_I23, _I127 = np.int32(23), np.int32(127)


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def _exp_single(x: Any) -> Any:
    """Return the same in float32, x in [-80, 0], to 2e-7."""
    n = np.int32(x * _LOG2_E - _HALF)
    step = np.float32(n)
    r = x - step * _LN2_HIGH
    r = r - step * _LN2_LOW
    p = _F7
    p = p * r + _F6
    p = p * r + _F5
    p = p * r + _F4
    p = p * r + _F3
    p = p * r + _HALF
    p = p * r + _ONE
    p = p * r + _ONE
    return p * np.int32(np.int32(n + _I127) << _I23).view(np.float32)


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def _log(x: Any) -> Any:
    """Log of a normal x > 0 in float64, to 3e-16 absolute or relative; branch-free."""
    bits = np.float64(x).view(np.int64)
    # x = 2^e m, m in [sqrt(1/2), sqrt(2))
    e = (bits - 0x3FE6A09E667F3BCD) >> 52
    m = np.int64(bits - (e << 52)).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    q = s * s
    p = 1 / 21.0
    p = p * q + 1 / 19.0
    p = p * q + 1 / 17.0
    p = p * q + 1 / 15.0
    p = p * q + 1 / 13.0
    p = p * q + 1 / 11.0
    p = p * q + 1 / 9.0
    p = p * q + 1 / 7.0
    p = p * q + 1 / 5.0
    p = p * q + 1 / 3.0
    p = p * q * s + s
    return np.float64(e) * 0.6931471805599453 + 2.0 * p


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def _natural_parameters(
    log_scale: float, precisions: Array, mean: Array, center: Array, offset: Array, eta: Array, k: int
) -> None:
    """Eta of one component relative to a tile's centre, in float64, into eta[k]; offset = centre - mean."""
    dim = len(center)
    constant = log_scale
    for a in range(dim):
        offset[a] = center[a] - mean[a]
    row = 1 + dim
    for a in range(dim):
        slope = 0.0
        for b in range(dim):
            slope += precisions[a, b] * offset[b]
        constant -= 0.5 * slope * offset[a]
        eta[k, 1 + a] = -slope
        for b in range(a, dim):
            eta[k, row] = -0.5 * precisions[a, b] if a == b else -precisions[a, b]
            row += 1
    eta[k, 0] = constant


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def _logits(eta: Array, k: int, features: Array, out: Array) -> None:
    """Write out[k, t] = eta[k] . phi_t for a block."""
    for t in range(_BLOCK):
        out[k, t] = eta[k, 0]
    f = 1
    while f + 3 <= eta.shape[1]:
        e0, e1, e2 = eta[k, f], eta[k, f + 1], eta[k, f + 2]
        for t in range(_BLOCK):
            out[k, t] += e0 * features[f, t] + e1 * features[f + 1, t] + e2 * features[f + 2, t]
        f += 3
    while f < eta.shape[1]:
        e0 = eta[k, f]
        for t in range(_BLOCK):
            out[k, t] += e0 * features[f, t]
        f += 1


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _add_moments(likelihoods: Array, k: int, weighted: Array, into: Array) -> None:
    """Add to into[k, f] sum_t likelihoods[k, t] weighted[f, t]."""
    zero = likelihoods[k, 0] - likelihoods[k, 0]
    f = 0
    while f + 2 <= into.shape[1]:
        s0 = s1 = zero
        for t in range(_BLOCK):
            s0 += likelihoods[k, t] * weighted[f, t]
            s1 += likelihoods[k, t] * weighted[f + 1, t]
        into[k, f] += s0
        into[k, f + 1] += s1
        f += 2
    if f < into.shape[1]:
        s0 = zero
        for t in range(_BLOCK):
            s0 += likelihoods[k, t] * weighted[f, t]
        into[k, f] += s0


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def _shift_moments(sums: Array, means: Array, center: Array, out: Array) -> None:
    """Shift moments (K, F) about the tile's centre to the old means, in float64."""
    dim = len(center)
    for k in range(len(sums)):
        count = np.float64(sums[k, 0])
        out[k, 0] = count
        row = 1 + dim
        for a in range(dim):
            d_a = center[a] - means[k, a]
            moved = sums[k, 1 + a] + count * d_a
            out[k, 1 + a] = moved
            for b in range(a, dim):  # (y + d)(y + d)^T = y y^T + y d^T + d (y + d)^T
                d_b = center[b] - means[k, b]
                out[k, row] = sums[k, row] + sums[k, 1 + a] * d_b + d_a * (sums[k, 1 + b] + count * d_b)
                row += 1


def _exp_of(x: Any) -> Any:
    """Return exp of x in x's own precision; compiled code takes one of the two above."""
    return np.exp(x)


@overload(_exp_of, strict=False)
def _exp_by_type(x: Any) -> Callable[[Any], Any]:
    def single(x: Any) -> Any:
        return _exp_single(x)

    def double(x: Any) -> Any:
        return _exp(x)

    return single if x.bitwidth == 32 else double


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _run(  # noqa: PLR0912, PLR0915
    first: int, last: int, places: Array, owner: Array, features: Array, weights: Array, centers: Array,
    log_scales: Array, extra: Array, precisions: Array, means: Array, moments: Array, values: Array,
) -> None:  # fmt: skip
    """E-step and moments of the tiles from first to last.

    One function, long as it is: a call that passes slices of arrays costs as much as the arithmetic of a block.
    """
    real_type = features.dtype.type  # float32 literals would turn the arithmetic into float64
    zero, floor = real_type(0.0), real_type(_FLOOR)
    num_components, dim = means.shape[1], means.shape[2]
    num_features, tile = features.shape[1], features.shape[2]
    precise = np.empty((num_components, num_features))
    eta = np.empty((num_components, num_features), features.dtype)
    offset = np.empty(dim)
    logits = np.empty((num_components, _BLOCK), features.dtype)
    weighted = np.empty((num_features, _BLOCK), features.dtype)
    block = np.empty((num_features, _BLOCK), features.dtype)
    sums = np.empty((num_components, num_features), features.dtype)
    active = np.empty(num_components, np.int64)
    peak: Array = np.empty(_BLOCK, features.dtype)
    total: Array = np.empty(_BLOCK, features.dtype)
    plain: Array = np.empty(_BLOCK, features.dtype)
    for g in range(first, last):
        b, place = owner[g], places[g]
        phi, w = features[place], weights[place, 0]
        for k in range(num_components):
            _natural_parameters(
                log_scales[b, k], precisions[b, k], means[b, k], centers[place], offset, precise, k
            )
            for f in range(num_features):
                eta[k, f] = precise[k, f]
                sums[k, f] = zero
        objective, log_likelihood = 0.0, 0.0
        for start in range(0, tile, _BLOCK):
            mass = w[start : start + _BLOCK]
            real = 0
            for t in range(_BLOCK):
                real += 1 if mass[t] > zero else 0
            if real == 0:
                continue  # padding
            for f in range(num_features):
                source = phi[f, start : start + _BLOCK]
                for t in range(_BLOCK):
                    block[f, t] = source[t]
            for k in range(num_components):
                _logits(eta, k, block, logits)
            for t in range(_BLOCK):
                peak[t] = logits[0, t]
                total[t] = zero
                plain[t] = zero
            for k in range(1, num_components):
                for t in range(_BLOCK):
                    peak[t] = max(peak[t], logits[k, t])
            count = 0
            for k in range(num_components):
                near = 0
                for t in range(_BLOCK):
                    near += 1 if logits[k, t] - peak[t] > floor else 0
                if near == 0:
                    continue
                active[count] = k
                count += 1
                for t in range(_BLOCK):
                    logits[k, t] = _exp_of(max(logits[k, t] - peak[t], floor))
                factor = extra[b, k]
                for t in range(_BLOCK):
                    total[t] += logits[k, t]
                    plain[t] += logits[k, t] * factor
            value, bare = 0.0, 0.0
            for t in range(_BLOCK):
                weight = np.float64(mass[t])
                value += weight * (_log(np.float64(total[t])) + np.float64(peak[t]))
                bare += weight * (_log(np.float64(plain[t])) + np.float64(peak[t]))
                total[t] = mass[t] / total[t]
            objective += value
            log_likelihood += bare
            for f in range(num_features):
                for t in range(_BLOCK):
                    weighted[f, t] = block[f, t] * total[t]
            for i in range(count):
                k = active[i]
                _add_moments(logits, k, weighted, sums)
        values[g, 0] = objective
        values[g, 1] = log_likelihood
        _shift_moments(sums, means[b], centers[place], moments[g])


def moments_of_tiles(
    features: Tensor,
    weights: Tensor,
    centers: Tensor,
    places: Tensor,
    owner: Tensor,
    log_scales: Tensor,
    sums: Tensor,
    precisions: Tensor,
    means: Tensor,
) -> tuple[Tensor, Tensor]:
    """E-step of every tile, and its moments about the means of the mixtures that it was given.

    Args:
        features: phi of the stored points (S, F, T), float32 or float64: the precision of the arithmetic.
        weights: their weights (S, 1, T), of the same precision.
        centers: centres of the stored tiles (S, D) float64.
        places: where each tile of the batch is stored (G,) int64.
        owner: its cloud (G,) int64.
        log_scales: log-density of every component at its mean, less the floor's share (B, K) float64.
        sums: factors that undo the floor's share (B, K), of the precision of the arithmetic.
        precisions: S_k^-1 (B, K, D, D) float64.
        means: mu_k (B, K, D) float64.

    Returns:
        Moments [count, first, second] of every tile (G, K, F), and its objective and log-likelihood (G, 2), float64.
    """
    num_tiles, num_components = places.shape[0], means.shape[1]
    moments = np.empty((num_tiles, num_components, features.shape[1]))
    values = np.empty((num_tiles, 2))
    tensors = (places, owner, features, weights, centers, log_scales, sums, precisions, means)
    arrays: list[Any] = [*(t.numpy() for t in tensors[:5]), *(t.contiguous().numpy() for t in tensors[5:])]
    run: Callable[..., None] = _run
    threads = torch.get_num_threads()
    if threads == 1 or num_tiles * features.shape[2] * num_components < _SPLIT_ABOVE:
        run(0, num_tiles, *arrays, moments, values)
    else:
        cuts = [i * num_tiles // threads for i in range(threads + 1)]
        shares = [
            _pool(threads).submit(run, first, last, *arrays, moments, values)
            for first, last in itertools.pairwise(cuts[1:])
        ]
        run(0, cuts[1], *arrays, moments, values)
        for share in shares:
            share.result()
    return torch.from_numpy(moments), torch.from_numpy(values)


@lru_cache(maxsize=1)
def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads beside the caller's; the loops do not hold the interpreter's lock."""
    return ThreadPoolExecutor(threads - 1, thread_name_prefix="gmmtorch")
