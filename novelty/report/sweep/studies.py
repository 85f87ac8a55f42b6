"""What a sweep varied, cut into studies: the effect of one factor at a time, beside the detectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.report.sweep.runs import Factor, SweepRuns
from novelty.report.sweep.summary import METRICS, Group, Spread, group_rows, summarise

MOST_SERIES = 8
"""Lines that a figure can hold and still be read."""


@dataclass(frozen=True, eq=False)
class Study:
    """Scores against the values of one factor, for each value of another.

    Attributes:
        axis: What the scores are shown against; None where nothing but the series varies.
        series: What tells the lines apart: the detector where it varies; None for one line.
        pooled: Factors that are averaged over: those that vary among the runs with a value on the axis.
        groups: By (series, axis), the places in their values; a factor that is None has none.
    """

    axis: Factor | None
    series: Factor | None
    pooled: tuple[Factor, ...]
    groups: tuple[Group, ...]

    @property
    def key(self) -> str:
        """What tells the studies of a sweep apart."""
        return self.axis.key if self.axis else "all"

    @property
    def scored(self) -> bool:
        """Whether there is a score at all, that is a ground truth."""
        return any(spread.interval.count for group in self.groups for spread in group.spreads.values())

    @property
    def axis_label(self) -> str:
        """What the axis is called; empty where nothing varies."""
        return self.axis.label if self.axis else ""

    @property
    def series_names(self) -> list[str]:
        """What the legend calls the lines."""
        return [self.series.text(k) for k in range(len(self.series.values))] if self.series else ["all runs"]

    @property
    def axis_names(self) -> list[str]:
        """The values along the axis."""
        return [self.axis.text(k) for k in range(len(self.axis.values))] if self.axis else ["all runs"]

    def lines(self, num_runs: int) -> dict[str, NDArray[np.int64]]:
        """The runs of every line, as rows of the table, whether they have a value on the axis or not."""
        by = [self.series] if self.series else []
        return {
            self.series_names[places[0] if places else 0]: rows for places, rows in group_rows(by, num_runs)
        }

    def at(self, series: int, place: int) -> Group | None:
        """The runs of one line at one value; None where there are none."""
        wanted = (*([series] if self.series else []), *([place] if self.axis else []))
        return next((group for group in self.groups if group.places == wanted), None)

    def along(self, series: int, metric: str) -> list[tuple[int, Spread]]:
        """The places on the axis at which one line has a score, and the score."""
        groups = [(place, self.at(series, place)) for place in range(len(self.axis_names))]
        spreads = [(place, group.spreads[metric]) for place, group in groups if group is not None]
        return [(place, spread) for place, spread in spreads if spread.interval.count]


def studies(runs: SweepRuns, columns: Sequence[str] = tuple(METRICS)) -> list[Study]:
    """One study per factor besides the one that gives the series; one of all runs where there is none."""
    series = series_factor(runs)
    axes = [factor for factor in runs.factors if factor is not series]
    return [_study(runs, axis, series, columns) for axis in axes] or [_study(runs, None, series, columns)]


def series_factor(runs: SweepRuns) -> Factor | None:
    """What tells lines apart: the detector, else another factor of names, as far as few; None for one line."""
    few = [factor for factor in runs.factors if len(factor.values) <= MOST_SERIES]
    named = [factor for factor in few if factor.key == "detector" or not factor.numeric]
    return named[0] if named else None


def _study(runs: SweepRuns, axis: Factor | None, series: Factor | None, columns: Sequence[str]) -> Study:
    by = [factor for factor in (series, axis) if factor is not None]
    groups = tuple(summarise(runs, by, columns))
    rows = np.concatenate([group.rows for group in groups])
    pooled = tuple(f for f in runs.factors if f not in by and len(np.unique(f.codes[rows])) > 1)
    return Study(axis, series, pooled, groups)
