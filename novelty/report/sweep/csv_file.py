"""The numbers of a report as CSV: a line per combination of factors, or per difference between two sweeps."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from novelty.io import write_text
from novelty.report.sweep.comparison import COLUMNS, compare
from novelty.report.sweep.runs import Factor, SweepRuns
from novelty.report.sweep.studies import series_factor
from novelty.report.sweep.summary import summarise


def write_sweep_csv(path: str | Path, runs: SweepRuns, other: SweepRuns | None = None) -> None:
    """Write means, 95 % intervals and quartiles; of two sweeps, their paired differences.

    Raises:
        InputError: The sweeps have no run in common, or the file cannot be written.
    """
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerows(_combinations(runs) if other is None else _differences(runs, other))
    write_text(path, buffer.getvalue())


def _combinations(runs: SweepRuns) -> Iterator[Sequence[Any]]:
    factors = [_with_blank(factor) for factor in runs.factors]
    measures = ("mean", "low", "high", "lower_quartile", "median", "upper_quartile")
    names = [f"{column}_{measure}" for column in COLUMNS for measure in measures]
    yield [*(factor.key for factor in factors), "runs", "failed", *names]
    for group in summarise(runs, factors, COLUMNS):
        spreads = [group.spreads[column] for column in COLUMNS]
        numbers = [
            value
            for s in spreads
            for value in (s.interval.mean, s.interval.low, s.interval.high, *s.quartiles)
        ]
        values = [factor.text(place) for factor, place in zip(factors, group.places, strict=True)]
        yield [*values, len(group.rows), group.num_failed, *map(_cell, numbers)]


def _differences(runs: SweepRuns, other: SweepRuns) -> Iterator[Sequence[Any]]:
    series = series_factor(runs)
    yield [
        series.key if series else "runs_of",
        "quantity",
        "runs",
        "this_sweep",
        "other_sweep",
        "difference",
        "low",
        "high",
        "share_higher_in_other",
    ]
    for line in compare(runs, other, series).lines:
        for column, difference in line.differences.items():
            interval = difference.difference
            numbers = (difference.first, difference.second, interval.mean, interval.low, interval.high)
            yield [line.name, column, line.num_runs, *map(_cell, (*numbers, difference.better))]


def _with_blank(factor: Factor) -> Factor:
    """The factor with an empty value for the runs that have none, so that they are not left out."""
    if (factor.codes >= 0).all():
        return factor
    codes = np.where(factor.codes < 0, len(factor.values), factor.codes)
    return Factor(factor.key, (*factor.values, ""), codes)


def _cell(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"
