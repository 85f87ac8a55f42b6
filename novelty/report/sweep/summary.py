"""Means with intervals and spread, for groups of runs that have the same values of some factors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.evaluation.intervals import Interval, bootstrap_interval, t_interval
from novelty.report.sweep.runs import Factor, SweepRuns

METRICS = {
    "kappa": "κ",
    "cramers_v": "V",
    "uncertainty": "U",
    "f1": "F1",
    "iou": "IoU",
}
"""Columns of the scores that are reported, and what readers call them."""

MANY = 200
"""Values from which Student's interval takes the place of the bootstrap, which is then the same and slow."""


@dataclass(frozen=True)
class Spread:
    """A quantity over the runs of a group.

    Attributes:
        interval: Of its mean, at 95 %, over the pairs; the runs of one pair are averaged first.
        quartiles: Over the runs: 25 %, 50 % and 75 %; NaN where no run has a value.
    """

    interval: Interval
    quartiles: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Group:
    """The runs that have one combination of values.

    Attributes:
        places: The place of the value of each factor that the runs were grouped by.
        rows: The runs, as rows of the table.
        num_failed: How many of them have no answer.
        spreads: By column.
    """

    places: tuple[int, ...]
    rows: NDArray[np.int64]
    num_failed: int
    spreads: Mapping[str, Spread]


def summarise(
    runs: SweepRuns, factors: Sequence[Factor], columns: Sequence[str] = tuple(METRICS)
) -> list[Group]:
    """Group the runs by some factors, in the order of their values; runs that lack one of them are left out.

    Args:
        runs: All runs of the sweep.
        factors: What to group by; nothing gives one group of all runs.
        columns: What to average.
    """
    values = {column: runs.numbers(column) for column in columns}
    return [
        Group(
            places,
            rows,
            int(runs.failed[rows].sum()),
            {column: spread(numbers[rows], runs.pair_codes[rows]) for column, numbers in values.items()},
        )
        for places, rows in group_rows(factors, len(runs))
    ]


def group_rows(
    factors: Sequence[Factor], num_runs: int
) -> Iterator[tuple[tuple[int, ...], NDArray[np.int64]]]:
    """The places of the values and the rows of every combination that occurs, in order."""
    if not factors:
        yield (), np.arange(num_runs)
        return
    shape = tuple(len(factor.values) for factor in factors)
    codes = np.stack([factor.codes for factor in factors])
    rows = np.flatnonzero((codes >= 0).all(axis=0))
    flat = np.ravel_multi_index(tuple(codes[:, rows]), shape)
    order = np.argsort(flat, kind="stable")
    ordered = flat[order]
    starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]]) if len(ordered) else ordered
    for start, members in zip(starts, np.split(rows[order], starts[1:]), strict=True):
        yield tuple(int(place) for place in np.unravel_index(ordered[start], shape)), members


def spread(values: NDArray[np.float64], pairs: NDArray[np.int64]) -> Spread:
    """Mean, interval and quartiles of one quantity; NaN is left out.

    Args:
        values: (R,) of the runs.
        pairs: (R,) number of each run's pair.
    """
    defined = ~np.isnan(values)
    if not defined.any():
        return Spread(t_interval([]), (np.nan, np.nan, np.nan))
    quartiles = np.quantile(values[defined], (0.25, 0.5, 0.75))
    lower, middle, upper = (float(value) for value in quartiles)
    return Spread(mean_interval(pair_means(values, pairs)), (lower, middle, upper))


def pair_means(values: NDArray[np.float64], pairs: NDArray[np.int64]) -> NDArray[np.float64]:
    """The mean of the defined values of every pair that has one, (P,)."""
    defined = ~np.isnan(values)
    _, codes = np.unique(pairs[defined], return_inverse=True)
    return np.bincount(codes, values[defined]) / np.bincount(codes)


def mean_interval(values: NDArray[np.float64]) -> Interval:
    """The 95 % interval of a mean: by bootstrap, or by Student where there are many values."""
    return t_interval(values) if len(values) >= MANY else bootstrap_interval(values)
