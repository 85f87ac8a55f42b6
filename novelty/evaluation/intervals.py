"""How sure a score is: intervals over repetitions, and a test between two methods on the same points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.errors import InputError
from novelty.evaluation.contingency import ContingencyTable


@dataclass(frozen=True)
class Interval:
    """A mean over repetitions and where the true mean lies.

    Attributes:
        mean: Of the defined values; NaN when there are none.
        low: Lower end; NaN with fewer than two values.
        high: Upper end; NaN with fewer than two values.
        count: Number of defined values; NaN values are left out.
    """

    mean: float
    low: float
    high: float
    count: int

    @property
    def half_width(self) -> float:
        """Half of the interval's width."""
        return (self.high - self.low) / 2

    def __str__(self) -> str:
        if math.isnan(self.half_width):
            return f"{self.mean:.3f}"
        return f"{self.mean:.3f} [{self.low:.3f}, {self.high:.3f}]"


@dataclass(frozen=True)
class McNemar:
    """McNemar's test of two methods on the same points.

    Attributes:
        first_only: Points that only the first method labels rightly.
        second_only: Points that only the second method labels rightly.
        p_value: Probability of so uneven a split if both were equally often right; 1 when they never differ.
        count: Points that were counted.
    """

    first_only: int
    second_only: int
    p_value: float
    count: int


def t_interval(values: ArrayLike, level: float = 0.95) -> Interval:
    """Student's interval of the mean; exact for normal values, fair for ten repetitions or more of others.

    Args:
        values: One value per repetition; NaN is left out.
        level: Probability that the interval holds the mean, in (0, 1).

    Raises:
        InputError: The level is not in (0, 1), or the values are not one-dimensional.
    """
    from scipy.special import stdtrit

    defined = _defined(values, level)
    if len(defined) < 2:
        return _point(defined)
    mean = float(defined.mean())
    error = float(defined.std(ddof=1)) / math.sqrt(len(defined))
    half = float(stdtrit(len(defined) - 1, (1 + level) / 2)) * error
    return Interval(mean, mean - half, mean + half, len(defined))


def proportion_interval(outcomes: ArrayLike, level: float = 0.95) -> Interval:
    """Wilson's score interval of a probability; inside [0, 1] and of sensible width even where all outcomes are equal.

    Equals `scipy.stats.binomtest(k, n).proportion_ci(level, method="wilson")`.

    Args:
        outcomes: Whether each trial succeeded, bool (R,).
        level: Probability that the interval holds the true one, in (0, 1).

    Raises:
        InputError: The level is not in (0, 1), or the outcomes are not one-dimensional.
    """
    from scipy.special import ndtri

    defined = _defined(outcomes, level)
    count = len(defined)
    if not count:
        return _point(defined)
    share, z = float(defined.mean()), float(ndtri((1 + level) / 2))
    centre = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * math.sqrt(share * (1 - share) / count + (z / (2 * count)) ** 2) / (1 + z**2 / count)
    return Interval(share, max(centre - half, 0.0), min(centre + half, 1.0), count)


def bootstrap_interval(
    values: ArrayLike, level: float = 0.95, resamples: int = 2000, seed: int = 0
) -> Interval:
    """Percentile bootstrap of the mean; for kappa near 1, whose distribution is skewed and ends there.

    Args:
        values: One value per repetition; NaN is left out.
        level: Probability that the interval holds the mean, in (0, 1).
        resamples: Samples drawn with replacement.
        seed: Of the draws.

    Raises:
        InputError: The level is not in (0, 1), or the values are not one-dimensional.
    """
    defined = _defined(values, level)
    if len(defined) < 2:
        return _point(defined)
    draws = np.random.default_rng(seed).integers(len(defined), size=(resamples, len(defined)))
    tails = ((1 - level) / 2, (1 + level) / 2)
    low, high = np.quantile(defined[draws].mean(axis=1), tails)
    return Interval(float(defined.mean()), float(low), float(high), len(defined))


def mcnemar(
    truth: ArrayLike, first: ArrayLike, second: ArrayLike, ignore: ArrayLike | None = None
) -> McNemar:
    """Exact two-sided McNemar test: are two methods equally often right on these points?

    Points of one scan are correlated, so that a small p-value says less than it seems; `mcnemar_over_scans` takes whole
    scans for what varies. Equals `scipy.stats.binomtest(first_only, first_only + second_only)`.

    Args:
        truth: Whether each point is novel, bool (N,).
        first: Whether the first method called it novel, bool (N,).
        second: Whether the second method did, bool (N,).
        ignore: Points that are not counted, bool (N,); None counts all.

    Raises:
        InputError: The lengths differ, or an array holds something else than truth values.
    """
    from scipy.special import bdtr

    for labels in (first, second):
        ContingencyTable.from_labels(truth, labels, ignore)  # checks shapes and values
    kept = np.ones(np.shape(truth), bool) if ignore is None else ~np.asarray(ignore, dtype=bool)
    right = [np.asarray(labels, dtype=bool) == np.asarray(truth, dtype=bool) for labels in (first, second)]
    first_only = int((right[0] & ~right[1] & kept).sum())
    second_only = int((right[1] & ~right[0] & kept).sum())
    tail = float(bdtr(min(first_only, second_only), first_only + second_only, 0.5))
    return McNemar(first_only, second_only, min(1.0, 2 * tail), int(kept.sum()))


def mcnemar_over_scans(tests: Sequence[McNemar]) -> float:
    """p-value of McNemar's test over scans whose points are correlated; 1 when the methods never differ.

    X^2 = (sum_k d_k)^2 / sum_k d_k^2 with d_k the difference of both methods' shares of right points in scan k,
    asymptotically chi-squared with one degree of freedom (Durkalski, Palesch, Lipsitz & Rust, Statistics in Medicine 22
    (2003) 2417). One scan on its own never is evidence: X^2 is 1 then.

    Args:
        tests: One per scan, of the same two methods.
    """
    from scipy.special import chdtrc

    differences = np.array([(test.first_only - test.second_only) / max(test.count, 1) for test in tests])
    spread = float(np.square(differences).sum())
    return float(chdtrc(1, float(differences.sum()) ** 2 / spread)) if spread else 1.0


def _defined(values: ArrayLike, level: float) -> NDArray[np.float64]:
    if not 0 < level < 1:
        raise InputError(f"the level of an interval must lie between 0 and 1; got {level}.")
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise InputError(f"expected one value per repetition, shape (R,); got {array.shape}.")
    return array[~np.isnan(array)]


def _point(defined: NDArray[np.float64]) -> Interval:
    mean = float(defined[0]) if len(defined) else math.nan
    return Interval(mean, math.nan, math.nan, len(defined))
