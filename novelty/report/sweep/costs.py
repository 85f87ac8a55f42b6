"""Where the time went: seconds per stage, and runs per second of the clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from novelty.report.sweep.runs import SweepRuns
from novelty.report.sweep.studies import Study
from novelty.sweep.rows import STAGES


@dataclass(frozen=True, eq=False)
class Costs:
    """What the runs cost.

    Attributes:
        seconds: Mean seconds per run and stage, per line of the figures and then for all runs.
        total: Sum of the seconds of all runs.
        clock: Seconds in which at least one batch was at work.
        workers: Processes that took part.
        peak_memory: Highest resident memory of a process, bytes; NaN where unknown.
    """

    seconds: Mapping[str, Mapping[str, float]]
    total: float
    clock: float
    workers: int
    peak_memory: float


def costs(runs: SweepRuns, study: Study) -> Costs:
    """Add up what the rows say; lines are those of a study."""
    stages = {stage: np.nan_to_num(runs.numbers(f"seconds_{stage}")) for stage in STAGES}
    groups = study.lines(len(runs))
    if len(groups) > 1:
        groups["all"] = np.arange(len(runs))
    peaks = runs.numbers("peak_memory")
    return Costs(
        {
            name: {stage: _mean(values[rows], runs.failed[rows]) for stage, values in stages.items()}
            for name, rows in groups.items()
        },
        float(sum(values.sum() for values in stages.values())),
        _covered(_seconds(runs, "started"), _seconds(runs, "finished")),
        len(runs.distinct("worker")),
        float(np.nanmax(peaks)) if not np.isnan(peaks).all() else np.nan,
    )


def _mean(values: NDArray[np.float64], failed: NDArray[np.bool_]) -> float:
    """Over the runs that have an answer."""
    answered = values[~failed]
    return float(answered.mean()) if len(answered) else np.nan


def _seconds(runs: SweepRuns, column: str) -> NDArray[np.float64]:
    return runs.table[column].cast(pa.int64()).cast(pa.float64()).fill_null(np.nan).to_numpy() * 1e-6


def _covered(starts: NDArray[np.float64], ends: NDArray[np.float64]) -> float:
    """Length of the union of intervals."""
    known = ~(np.isnan(starts) | np.isnan(ends))
    if not known.any():
        return np.nan
    order = np.argsort(starts[known])
    starts, ends = starts[known][order], ends[known][order]
    reached = np.r_[-np.inf, np.maximum.accumulate(ends)[:-1]]
    return float(np.maximum(ends - np.maximum(starts, reached), 0).sum())
