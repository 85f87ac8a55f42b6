"""What an iteration does once per component: the M-step and its over-relaxation, and what the E-step reads.

The same as `maximization`, `extrapolate` and `em_step` of `gmmtorch.em`, cloud by cloud, in float64 and in place. The
statistics of a component are one row [N_k, first, second] of M = 1 + D + P numbers, P = D (D + 1) / 2: moments about
the mean of the mixture that the E-step saw, the second ones packed.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from gmmtorch.compiled.points import EXTRA, MEAN, SCALE, SLACK
from gmmtorch.components import ABSENT
from gmmtorch.em import LEAST_SHARE, LONGEST_STEP, ROUND_OFF
from gmmtorch.statistics import LARGEST_SLACK

__all__ = ["accept", "cholesky", "collect", "describe", "maximize"]

Array = np.ndarray

_LOG_2_PI = math.log(2.0 * math.pi)


@njit(nogil=True, error_model="numpy", cache=True)
def cholesky(matrices: Array, b: int, k: int, factor: Array) -> bool:
    """Lower Cholesky factor of matrices[b, k] (D, D); False where there is none."""
    dim = factor.shape[0]
    for i in range(dim):
        for j in range(i + 1):
            value = matrices[b, k, i, j]
            for c in range(j):
                value -= factor[i, c] * factor[j, c]
            if i > j:
                factor[i, j] = value / factor[j, j]
            elif value > 0.0 and value < np.inf:
                factor[i, i] = math.sqrt(value)
            else:
                return False
    return True


@njit(nogil=True, error_model="numpy", cache=True)
def describe(clouds: Array, weights: Array, means: Array, factors: Array, floor: Array, form: Array) -> None:
    """Lay out what the E-step reads of these clouds' mixtures, one row of `form` (B, 3 + D + 2 P, K) each.

    SCALE, log pi_k N(mu_k) less SLACK; SLACK, tr(P_k) delta^2 / 2 of the floor delta; EXTRA, exp of it; D rows from
    MEAN on, mu_k; P rows of the lower triangle of L_k^-1; and P rows of the packed P_k, its off-diagonals doubled.
    """
    num_components, dim = means.shape[1], means.shape[2]
    inverse = np.zeros((dim, dim))
    for b in clouds:
        for k in range(num_components):
            log_scale = math.log(weights[b, k]) if weights[b, k] > 0.0 else ABSENT
            log_scale -= 0.5 * dim * _LOG_2_PI
            row, trace = MEAN + dim, 0.0
            for i in range(dim):
                form[b, MEAN + i, k] = means[b, k, i]
                log_scale -= math.log(factors[b, k, i, i])
                for j in range(i + 1):
                    value = 1.0 if i == j else 0.0
                    for c in range(j, i):
                        value -= factors[b, k, i, c] * inverse[c, j]
                    inverse[i, j] = value / factors[b, k, i, i]
                    form[b, row, k] = inverse[i, j]
                    trace += inverse[i, j] * inverse[i, j]
                    row += 1
            for i in range(dim):
                for j in range(i, dim):
                    value = 0.0
                    for c in range(j, dim):
                        value += inverse[c, i] * inverse[c, j]
                    form[b, row, k] = value if i == j else 2.0 * value
                    row += 1
            slack = 0.5 * floor[b] * floor[b] * trace if weights[b, k] > 0.0 else 0.0
            form[b, SCALE, k] = log_scale - slack
            form[b, SLACK, k] = min(slack, LARGEST_SLACK)
            form[b, EXTRA, k] = math.exp(form[b, SLACK, k])


@njit(nogil=True, error_model="numpy", cache=True)
def collect(
    clouds: Array, unit_offsets: Array, moments: Array, values: Array, factors: Array,
    statistics: Array, totals: Array,
) -> None:  # fmt: skip
    """Add up the units of these clouds, and bring moments of y = L^-1 (x - mu) back to those of x - mu.

    Args:
        clouds: which (B',) int64.
        unit_offsets: units of cloud b are unit_offsets[b] to unit_offsets[b + 1] (B + 1,).
        moments: of every unit (U, K, M), or (U, K, M + P) with the spreads of cells.
        values: of every unit (U, 2).
        factors: L of the mixtures that the E-step saw (B, K, D, D).
        statistics: takes those of every component (B, K, M).
        totals: takes the objective and the log-likelihood (B, 2).
    """
    num_components, num_moments = moments.shape[1], moments.shape[2]
    dim, plain = factors.shape[2], statistics.shape[2]
    summed, second, half = np.zeros(num_moments), np.zeros((dim, dim)), np.zeros((dim, dim))
    for b in clouds:
        totals[b, 0] = totals[b, 1] = 0.0
        for u in range(unit_offsets[b], unit_offsets[b + 1]):
            totals[b, 0] += values[u, 0]
            totals[b, 1] += values[u, 1]
        for k in range(num_components):
            for m in range(num_moments):
                summed[m] = 0.0
                for u in range(unit_offsets[b], unit_offsets[b + 1]):
                    summed[m] += moments[u, k, m]
            statistics[b, k, 0] = summed[0]
            place = 1 + dim
            for i in range(dim):
                value = 0.0
                for c in range(i + 1):
                    value += factors[b, k, i, c] * summed[1 + c]
                statistics[b, k, 1 + i] = value
                for j in range(i, dim):
                    second[i, j] = second[j, i] = summed[place]
                    place += 1
            for i in range(dim):
                for j in range(dim):
                    value = 0.0
                    for c in range(i + 1):
                        value += factors[b, k, i, c] * second[c, j]
                    half[i, j] = value
            place = 1 + dim
            for i in range(dim):
                for j in range(i, dim):
                    value = summed[plain + place - 1 - dim] if num_moments > plain else 0.0
                    for c in range(j + 1):
                        value += half[i, c] * factors[b, k, j, c]
                    statistics[b, k, place] = value
                    place += 1


@njit(nogil=True, error_model="numpy", cache=True)
def _lengthen(
    b: int, step: float, total: float, added: float, weights: Array, covariances: Array, statistics: Array,
    target: Array, trial: Array, factor: Array,
) -> bool:  # fmt: skip
    """Statistics beyond those of the E-step, into `target`; False where they leave no mixture (see `extrapolate`)."""
    first = np.int64(0)
    num_components, dim = covariances.shape[1], covariances.shape[2]
    for k in range(num_components):
        before = weights[b, k] * total
        target[k, 0] = before + step * (statistics[b, k, 0] - before)
        place = 1 + dim
        for i in range(dim):
            target[k, 1 + i] = step * statistics[b, k, 1 + i]
            for j in range(i, dim):
                spread = before * (covariances[b, k, i, j] - (added if i == j else 0.0))
                target[k, place] = spread + step * (statistics[b, k, place] - spread)
                place += 1
        if weights[b, k] > 0.0:
            if not target[k, 0] > LEAST_SHARE * statistics[b, k, 0]:
                return False
            _covariance(target, k, added, 0.0, trial, first, first)
            if not cholesky(trial, first, first, factor):
                return False
    return True


@njit(nogil=True, error_model="numpy", cache=True)
def _covariance(
    target: Array, k: int, added: float, round_off: float, covariances: Array, b: int, slot: int
) -> None:
    """Covariance of a component's share, the floor and what the moments are uncertain by, into covariances[b, slot]."""
    dim = covariances.shape[2]
    count, place, trace = target[k, 0], 1 + dim, 0.0
    for i in range(dim):
        for j in range(i, dim):
            value = target[k, place] / count - target[k, 1 + i] / count * (target[k, 1 + j] / count)
            covariances[b, slot, i, j] = covariances[b, slot, j, i] = value
            place += 1
        trace += covariances[b, slot, i, i]
    for i in range(dim):
        covariances[b, slot, i, i] += added + round_off * trace


@njit(nogil=True, error_model="numpy", cache=True)
def maximize(
    clouds: Array, step: Array, total: Array, starved: Array, added: Array, statistics: Array,
    weights: Array, means: Array, covariances: Array, factors: Array,
    new_weights: Array, new_means: Array, new_covariances: Array, new_factors: Array,
) -> None:  # fmt: skip
    """M-step of these clouds, over-relaxed where their step is longer than 1 and the longer step is possible.

    The statistics are those of the E-step with the mixtures `weights` to `factors`; the new mixtures go into
    `new_weights` to `new_factors`.
    """
    num_components, dim = means.shape[1], means.shape[2]
    factor, trial = np.zeros((dim, dim)), np.zeros((1, 1, dim, dim))
    target = np.zeros((num_components, statistics.shape[2]))
    for b in clouds:
        lengthened = step[b] > 1.0 and _lengthen(
            b, step[b], total[b], added[b], weights, covariances, statistics, target, trial, factor
        )
        if not lengthened:
            for k in range(num_components):
                for m in range(statistics.shape[2]):
                    target[k, m] = statistics[b, k, m]
        kept = 0.0
        for k in range(num_components):
            usable = weights[b, k] > 0.0 and target[k, 0] > starved[b]
            new_weights[b, k] = target[k, 0] if usable else 0.0
            kept += new_weights[b, k]
            if usable:
                _covariance(target, k, added[b], ROUND_OFF, new_covariances, b, k)
                usable = cholesky(new_covariances, b, k, factor)
            for i in range(dim):
                new_means[b, k, i] = means[b, k, i] + (target[k, 1 + i] / target[k, 0] if usable else 0.0)
                for j in range(dim):
                    if not usable:
                        new_covariances[b, k, i, j] = covariances[b, k, i, j]
                    new_factors[b, k, i, j] = factor[i, j] if usable else factors[b, k, i, j]
        for k in range(num_components):
            new_weights[b, k] /= kept if kept > 0.0 else 1.0


@njit(nogil=True, error_model="numpy", cache=True)
def accept(
    clouds: Array, relaxation: float, tolerance: Array, new_totals: Array, new_statistics: Array,
    new_weights: Array, new_means: Array, new_covariances: Array, new_factors: Array,
    totals: Array, statistics: Array, weights: Array, means: Array, covariances: Array, factors: Array,
    gain: Array, num_iterations: Array, converged: Array, step: Array,
) -> None:  # fmt: skip
    """Take the new mixtures of these clouds, unless a longer step has lowered the objective.

    Only a step of EM's own ends the iterations of a cloud: a gain of at most its tolerance (B,), NaN for never.
    """
    num_components, dim = means.shape[1], means.shape[2]
    for b in clouds:
        num_iterations[b] += 1
        won = new_totals[b, 0] - totals[b, 0]
        plain = step[b] <= 1.0
        if not (plain or won >= 0.0):
            step[b] = 1.0
            continue
        small = won <= tolerance[b]
        converged[b] |= small and plain
        step[b] = 1.0 if small else min(step[b] * relaxation, LONGEST_STEP)
        gain[b] = won
        totals[b, 0], totals[b, 1] = new_totals[b, 0], new_totals[b, 1]
        for k in range(num_components):
            weights[b, k] = new_weights[b, k]
            for m in range(statistics.shape[2]):
                statistics[b, k, m] = new_statistics[b, k, m]
            for i in range(dim):
                means[b, k, i] = new_means[b, k, i]
                for j in range(dim):
                    covariances[b, k, i, j] = new_covariances[b, k, i, j]
                    factors[b, k, i, j] = new_factors[b, k, i, j]
