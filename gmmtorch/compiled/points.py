"""The pass over the points: responsibilities and moments, block by block, while they are in the first-level cache.

A block of T = 128 points (a tile of `gmmtorch.tiles`) is whitened by every component that matters there,

    y = L^-1 (x - mu) = L^-1 x' + L^-1 (c - mu),        logit = log pi N(mu) - |y|^2 / 2,

with x' relative to the block's centre c and the second term in float64. What is summed up are moments of y, of a
component's own position and scale: neither step loses digits, in float32 either.

A component matters where it can come within 46 nats (1e-20) of another one. The component nearest to the centre is
whitened first; its least logit in the block is a bound below. The bound above for another one follows from its
distance to the centre and the ellipsoid c + z, z^T R^-1 z <= 1, around the block: |L^-1 z| <= tr(R P)^(1/2). In rooms
four of five components are left out by these bounds alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from gmmtorch.compiled.arithmetic import exp, log
from gmmtorch.tiles import TILE

__all__ = ["EXTRA", "MEAN", "SCALE", "SLACK", "pass_over_points", "place_center", "whiten"]

Array = np.ndarray

SCALE, SLACK, EXTRA, MEAN = range(4)
"""Rows of `form`: see `gmmtorch.compiled.mixtures.describe`."""
_NEAR = 46.0
_LOWEST = np.float32(-80.0)  # exp of less is a denormal number in float32
_HALF = np.float32(0.5)
_FAST = {"reassoc", "contract", "nsz", "nnan"}  # sums may be reordered into vector lanes; there are no NaNs


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def place_center(g: int, b: int, centers: Array, form: Array, offsets: Array, squared: Array) -> None:
    """Whitened coordinates of a block's centre (D, K), and their squared lengths (K,), for all components."""
    dim, num_components = offsets.shape
    row = MEAN + dim
    for k in range(num_components):
        squared[k] = 0.0
    for a in range(dim):
        for k in range(num_components):
            offsets[a, k] = 0.0
        for c in range(a + 1):
            for k in range(num_components):
                offsets[a, k] += form[b, row, k] * (centers[g, c] - form[b, MEAN + c, k])
            row += 1
        for k in range(num_components):
            squared[k] += offsets[a, k] * offsets[a, k]


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _bounds(g: int, b: int, reach: Array, form: Array, squared: Array, above: Array) -> int:
    """Bounds on the logits of all components in a block (K,), before spreads; returns the component nearest to it."""
    num_components = len(squared)
    precision = form.shape[1] - reach.shape[1]
    for k in range(num_components):
        above[k] = 0.0
    for p in range(reach.shape[1]):
        for k in range(num_components):
            above[k] += reach[g, p] * form[b, precision + p, k]
    nearest, highest = 0, -np.inf
    for k in range(num_components):
        gap = max(np.sqrt(squared[k]) - np.sqrt(above[k]), 0.0)
        above[k] = form[b, SCALE, k] + form[b, SLACK, k] - 0.5 * gap * gap
        at_center = form[b, SCALE, k] - 0.5 * squared[k]
        if at_center > highest:
            nearest, highest = k, at_center
    return nearest


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _whiten_3d(
    row: int, b: int, k: int, form: Array, offsets: Array, numbers: Array, x: Array, y: Array, logits: Array
) -> None:
    """Whitened coordinates and logits of a block in three dimensions."""
    for i in range(6):
        numbers[i] = form[b, MEAN + 3 + i, k]
    for a in range(3):
        numbers[6 + a] = offsets[a, k]
    numbers[9] = form[b, SCALE, k]
    w0, w1, w2, w3, w4, w5 = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5]
    o0, o1, o2, scale = numbers[6], numbers[7], numbers[8], numbers[9]
    first = 3 * row
    for t in range(TILE):
        y0 = o0 + w0 * x[0, t]
        y1 = o1 + w1 * x[0, t] + w2 * x[1, t]
        y2 = o2 + w3 * x[0, t] + w4 * x[1, t] + w5 * x[2, t]
        y[first, t] = y0
        y[first + 1, t] = y1
        y[first + 2, t] = y2
        logits[row, t] = scale - _HALF * (y0 * y0 + y1 * y1 + y2 * y2)


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _whiten_nd(
    row: int, b: int, k: int, form: Array, offsets: Array, numbers: Array, x: Array, y: Array, logits: Array
) -> None:
    """Whitened coordinates and logits of a block in any number of dimensions."""
    dim = x.shape[0]
    numbers[0] = form[b, SCALE, k]
    for t in range(TILE):
        logits[row, t] = numbers[0]
    entry = MEAN + dim
    for a in range(dim):
        numbers[0] = offsets[a, k]
        for t in range(TILE):
            y[dim * row + a, t] = numbers[0]
        for c in range(a + 1):
            numbers[0] = form[b, entry, k]
            factor = numbers[0]
            for t in range(TILE):
                y[dim * row + a, t] += factor * x[c, t]
            entry += 1
        for t in range(TILE):
            logits[row, t] -= _HALF * y[dim * row + a, t] * y[dim * row + a, t]


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _subtract_spread(
    row: int, b: int, k: int, form: Array, numbers: Array, spread: Array, logits: Array
) -> None:
    """Take tr(P_k S_t) / 2 off the logits of a block of cells."""
    precision = form.shape[1] - spread.shape[0]
    for p in range(spread.shape[0]):
        numbers[0] = form[b, precision + p, k]
        factor = _HALF * numbers[0]
        for t in range(TILE):
            logits[row, t] -= factor * spread[p, t]


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def whiten(
    row: int, b: int, k: int, form: Array, offsets: Array, numbers: Array, x: Array, spread: Array,
    cells: bool, y: Array, logits: Array,
) -> None:  # fmt: skip
    """Whitened coordinates (rows D row to D row + D of y) and logits (row) of a block by component k of cloud b."""
    if x.shape[0] == 3:
        _whiten_3d(row, b, k, form, offsets, numbers, x, y, logits)
    else:
        _whiten_nd(row, b, k, form, offsets, numbers, x, y, logits)
    if cells:
        _subtract_spread(row, b, k, form, numbers, spread, logits)


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _exponentiate(
    row: int, extra: Any, edge: Any, peak: Array, logits: Array, total: Array, bare: Array
) -> bool:
    """Likelihoods relative to the peak, added to their sums; False where the component is nowhere near."""
    largest = logits[row, 0] - peak[0]
    for t in range(TILE):
        largest = max(largest, logits[row, t] - peak[t])
    if largest <= edge:
        return False
    for t in range(TILE):
        likelihood = exp(max(logits[row, t] - peak[t], _LOWEST))
        logits[row, t] = likelihood
        total[t] += likelihood
        bare[t] += likelihood * extra
    return True


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _value(u: int, mass: Array, peak: Array, total: Array, bare: Array, values: Array) -> None:
    """Add a block's log-likelihoods with and without the floor; replaces the totals by mass / total."""
    objective, log_likelihood = 0.0, 0.0
    for t in range(TILE):
        weight = np.float64(mass[t])
        objective += weight * (log(np.float64(total[t])) + np.float64(peak[t]))
        log_likelihood += weight * (log(np.float64(bare[t])) + np.float64(peak[t]))
        total[t] = mass[t] / total[t]
    values[u, 0] += objective
    values[u, 1] += log_likelihood


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _add_moments_3d(u: int, k: int, row: int, share: Array, y: Array, moments: Array) -> None:
    """Add sum_t r_t [1, y, y y^T] of a block in three dimensions."""
    zero = share[0] - share[0]
    count = first0 = first1 = first2 = zero
    s00 = s01 = s02 = s11 = s12 = s22 = zero
    first = 3 * row
    for t in range(TILE):
        r = share[t]
        y0, y1, y2 = y[first, t], y[first + 1, t], y[first + 2, t]
        r0, r1, r2 = r * y0, r * y1, r * y2
        count += r
        first0 += r0
        first1 += r1
        first2 += r2
        s00 += r0 * y0
        s01 += r0 * y1
        s02 += r0 * y2
        s11 += r1 * y1
        s12 += r1 * y2
        s22 += r2 * y2
    moments[u, k, 0] += np.float64(count)
    moments[u, k, 1] += np.float64(first0)
    moments[u, k, 2] += np.float64(first1)
    moments[u, k, 3] += np.float64(first2)
    moments[u, k, 4] += np.float64(s00)
    moments[u, k, 5] += np.float64(s01)
    moments[u, k, 6] += np.float64(s02)
    moments[u, k, 7] += np.float64(s11)
    moments[u, k, 8] += np.float64(s12)
    moments[u, k, 9] += np.float64(s22)


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _add_moments(u: int, k: int, row: int, dim: int, share: Array, y: Array, moments: Array) -> None:
    """Add sum_t r_t [1, y, y y^T] of a block in any number of dimensions."""
    zero = share[0] - share[0]
    count = zero
    for t in range(TILE):
        count += share[t]
    moments[u, k, 0] += np.float64(count)
    place = 1 + dim
    for a in range(dim):
        first = zero
        for t in range(TILE):
            first += share[t] * y[dim * row + a, t]
        moments[u, k, 1 + a] += np.float64(first)
        for c in range(a, dim):
            second = zero
            for t in range(TILE):
                second += share[t] * y[dim * row + a, t] * y[dim * row + c, t]
            moments[u, k, place] += np.float64(second)
            place += 1


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _add_spread(u: int, k: int, share: Array, spread: Array, moments: Array) -> None:
    """Add sum_t r_t S_t of a block of cells, in the caller's coordinates."""
    place = moments.shape[2] - spread.shape[0]
    for p in range(spread.shape[0]):
        summed = share[0] - share[0]
        for t in range(TILE):
            summed += share[t] * spread[p, t]
        moments[u, k, place + p] += np.float64(summed)


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _load(
    g: int, local: Array, spreads: Array, weights: Array,
    x: Array, spread: Array, mass: Array, total: Array, bare: Array,
) -> None:  # fmt: skip
    """Take a block's coordinates, spreads and weights into the precision of the pass, and clear its sums."""
    for t in range(TILE):
        mass[t] = weights[g, 0, t]
        total[t] = 0.0
        bare[t] = 0.0
    for a in range(x.shape[0]):
        for t in range(TILE):
            x[a, t] = local[g, a, t]
    if len(spreads) > 0:
        for p in range(spread.shape[0]):
            for t in range(TILE):
                spread[p, t] = spreads[g, p, t]


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def _whiten_near(
    nearest: int, b: int, above: Array, form: Array, offsets: Array, numbers: Array, x: Array, spread: Array,
    cells: bool, y: Array, logits: Array, peak: Array, chosen: Array,
) -> np.int64:  # fmt: skip
    """Whiten a block by the nearest component, then by those that can come near it; returns how many, in `chosen`."""
    count, lowest = np.int64(0), 0.0  # a literal 0 would compile `whiten` twice
    for j in range(-1, len(above)):
        k = nearest if j < 0 else j
        if j == nearest or (j >= 0 and above[k] <= lowest - _NEAR):
            continue
        whiten(count, b, k, form, offsets, numbers, x, spread, cells, y, logits)
        if j < 0:
            least = logits[0, 0]
            for t in range(TILE):
                peak[t] = logits[0, t]
                least = min(least, logits[0, t])
            lowest = np.float64(least)
        else:
            for t in range(TILE):
                peak[t] = max(peak[t], logits[count, t])
        chosen[count] = k
        count += 1
    return count


@njit(nogil=True, error_model="numpy", fastmath=_FAST, cache=True)
def pass_over_points(
    units: Array, first: int, last: int, owners: Array, starts: Array, stops: Array,
    local: Array, spreads: Array, weights: Array, centers: Array, reach: Array,
    form: Array, moments: Array, values: Array, precision: Array,
) -> None:  # fmt: skip
    """E-step of the units from first to last, stretches of blocks of one cloud each.

    Args:
        units: numbers of the units to pass (U',) int64.
        first: first of them to pass now; other threads pass others.
        last: the one after the last.
        owners: cloud of every unit (U,) int64.
        starts: first block of every unit (U,).
        stops: the one after its last (U,).
        local: coordinates relative to the block's centre (S, D, T) float64.
        spreads: packed spreads of cells (S, P, T), P = D (D + 1) / 2, or (0, P, T).
        weights: point weights, 0 for padding (S, 1, T).
        centers: (S, D).
        reach: packed matrices R of the ellipsoids around the blocks (S, P).
        form: what the mixtures look like (B, 3 + D + 2 P, K), see `gmmtorch.compiled.mixtures.describe`.
        moments: takes sum r w [1, y, y y^T, S] of every unit (U, K, M).
        values: takes its objective and log-likelihood (U, 2), nats.
        precision: an array of the type in which to compute.
    """
    dim, packed, num_components = local.shape[1], reach.shape[1], form.shape[2]
    cells = len(spreads) > 0
    x = np.empty((dim, TILE), precision.dtype)
    spread = np.empty((packed, TILE), precision.dtype)
    y = np.empty((dim * num_components, TILE), precision.dtype)
    logits = np.empty((num_components, TILE), precision.dtype)
    mass: Array = np.empty(TILE, precision.dtype)
    peak: Array = np.empty(TILE, precision.dtype)
    total: Array = np.empty(TILE, precision.dtype)
    bare: Array = np.empty(TILE, precision.dtype)
    share: Array = np.empty(TILE, precision.dtype)
    numbers: Array = np.empty(10, precision.dtype)
    offsets = np.empty((dim, num_components))
    squared, above = np.empty(num_components), np.empty(num_components)
    chosen = np.empty(num_components, np.int64)
    for i in range(first, last):
        u = units[i]
        b = owners[u]
        values[u, 0] = values[u, 1] = 0.0
        for k in range(num_components):
            for m in range(moments.shape[2]):
                moments[u, k, m] = 0.0
        for g in range(starts[u], stops[u]):
            place_center(g, b, centers, form, offsets, squared)
            nearest = _bounds(g, b, reach, form, squared, above)
            _load(g, local, spreads, weights, x, spread, mass, total, bare)
            count = _whiten_near(
                nearest, b, above, form, offsets, numbers, x, spread, cells, y, logits, peak, chosen
            )
            for row in range(count):
                numbers[0] = form[b, EXTRA, chosen[row]]
                numbers[1] = -_NEAR - form[b, SLACK, chosen[row]]
                if not _exponentiate(row, numbers[0], numbers[1], peak, logits, total, bare):
                    chosen[row] = -1
            _value(u, mass, peak, total, bare, values)
            for row in range(count):
                k = chosen[row]
                if k < 0:
                    continue
                for t in range(TILE):
                    share[t] = logits[row, t] * total[t]
                if dim == 3:
                    _add_moments_3d(u, k, row, share, y, moments)
                else:
                    _add_moments(u, k, row, dim, share, y, moments)
                if cells:
                    _add_spread(u, k, share, spread, moments)
