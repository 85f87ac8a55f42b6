"""The tables of a sweep's report."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass

from novelty.evaluation.intervals import Interval
from novelty.report.sweep.comparison import Comparison, Difference
from novelty.report.sweep.costs import Costs
from novelty.report.sweep.extremes import Extreme
from novelty.report.sweep.failures import Reason
from novelty.report.sweep.runs import SweepRuns
from novelty.report.sweep.studies import Study
from novelty.report.sweep.summary import METRICS
from novelty.report.tables import Column, Row, Table, number, thousands

NONE = "–"


@dataclass(frozen=True)
class ScoreCell:
    """A mean with its interval, and where it stands: `level` from 0 to 1, `best` of the table."""

    mean: str
    interval: str
    level: float
    best: bool


@dataclass(frozen=True)
class ScoreTable:
    """One metric: a row per value of the axis, a column per series."""

    metric: str
    label: str
    corner: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[ScoreCell | None, ...]], ...]


def score_table(study: Study, metric: str) -> ScoreTable:
    """Means with 95 % intervals of one metric."""
    means = [
        [_interval(study, series, place, metric) for series in range(len(study.series_names))]
        for place in range(len(study.axis_names))
    ]
    highest = max((i.mean for row in means for i in row if i and not math.isnan(i.mean)), default=math.nan)
    rows = tuple(
        (name, tuple(_score_cell(interval, highest) for interval in row))
        for name, row in zip(study.axis_names, means, strict=True)
    )
    corner = study.axis_label
    return ScoreTable(metric, METRICS[metric], corner, tuple(study.series_names), rows)


def _interval(study: Study, series: int, place: int, metric: str) -> Interval | None:
    group = study.at(series, place)
    return group.spreads[metric].interval if group else None


def _score_cell(interval: Interval | None, highest: float) -> ScoreCell | None:
    if interval is None or math.isnan(interval.mean):
        return None
    ends = "" if math.isnan(interval.low) else f"{interval.low:.3f} to {interval.high:.3f}"
    return ScoreCell(
        f"{interval.mean:.3f}", ends, min(max(interval.mean, 0.0), 1.0), interval.mean == highest
    )


def cost_table(costs: Costs) -> Table:
    """Seconds per run of every stage, and runs per second of computing."""
    stages = list(next(iter(costs.seconds.values())))
    columns = (
        Column("seconds per run", numeric=False),
        *map(Column, stages),
        Column("sum"),
        Column("runs per s"),
    )
    rows = []
    for name, seconds in costs.seconds.items():
        total = sum(seconds.values())
        cells = [_seconds(seconds[stage]) for stage in stages]
        rate = number(1 / total) if total > 0 else NONE
        rows.append(Row((name, *cells, _seconds(total), rate), "total" if name == "all" else ""))
    return Table(columns, tuple(rows))


def extreme_table(runs: SweepRuns, ends: Sequence[Extreme]) -> Table:
    """The runs at one end of the scale."""
    factors = [factor for factor in runs.factors if factor.key != "data"]
    columns = (
        Column("pair", numeric=False),
        *(Column(factor.label, numeric=False) for factor in factors),
        Column("repetition"),
        *map(Column, METRICS.values()),
        Column("K* before, now"),
        Column("seconds"),
    )
    return Table(columns, tuple(_extreme_row(runs, extreme.row) for extreme in ends))


def _extreme_row(runs: SweepRuns, row: int) -> Row:
    values = {name: runs.table[name][row].as_py() for name in (*METRICS, "pair", "repetition", "seconds")}
    orders = [runs.table[f"{role}_components"][row].as_py() for role in ("reference", "current")]
    factors = [factor for factor in runs.factors if factor.key != "data"]
    return Row(
        (
            values["pair"],
            *(factor.text(factor.codes[row]) if factor.codes[row] >= 0 else NONE for factor in factors),
            str(values["repetition"]),
            *(_number(values[metric]) for metric in METRICS),
            ", ".join(NONE if order is None else str(order) for order in orders),
            _number(values["seconds"]),
        )
    )


def reason_table(reasons: Sequence[Reason]) -> Table:
    """What went wrong, how often, and where."""
    columns = (Column("runs"), Column("reason", numeric=False), Column("pairs", numeric=False))
    rows = []
    for reason in reasons:
        more = reason.num_pairs - len(reason.pairs)
        pairs = ", ".join(reason.pairs) + (f" and {thousands(more)} more" if more else "")
        rows.append(Row((thousands(reason.num_runs), reason.message, pairs)))
    return Table(columns, tuple(rows))


def comparison_table(comparison: Comparison, metric: str) -> Table:
    """Both sweeps and the paired difference, for all runs and for each series."""
    columns = (
        Column("", numeric=False),
        Column("runs"),
        Column("this sweep"),
        Column("the other"),
        Column("difference"),
        Column("95 % interval"),
        Column("higher in the other"),
    )
    rows = []
    for line in comparison.lines:
        difference = line.differences[metric]
        cells = (line.name, thousands(line.num_runs), *_difference_cells(difference))
        rows.append(Row(cells, _mark(difference.difference, metric)))
    return Table(columns, tuple(rows))


def _difference_cells(difference: Difference) -> tuple[str, ...]:
    interval = difference.difference
    if math.isnan(interval.mean):
        return (NONE,) * 5
    ends = NONE if math.isnan(interval.low) else f"{interval.low:+.3f} to {interval.high:+.3f}"
    shares = f"{100 * difference.better:.0f} %"
    return number(difference.first), number(difference.second), f"{interval.mean:+.3f}", ends, shares


def _mark(interval: Interval, metric: str) -> str:
    """`better` or `worse` in the other sweep where the interval leaves no doubt."""
    if not (interval.low > 0 or interval.high < 0):
        return ""
    return "better" if (interval.low > 0) == (metric != "seconds") else "worse"


def version_rows(runs: SweepRuns) -> Table:
    """Versions and machines, as the rows say; several where several took part."""
    entries: dict[str, dict[str, None]] = {"code": dict.fromkeys(runs.distinct("code"))}
    for column in ("versions", "machine"):
        for text in runs.distinct(column):
            for name, value in json.loads(text).items():
                entries.setdefault(name, {})[str(value or "not installed")] = None
    rows = tuple(Row((name.replace("_", " "), ", ".join(values))) for name, values in entries.items())
    return Table((Column("what", numeric=False), Column("version", numeric=False)), rows)


def _seconds(value: float) -> str:
    return NONE if math.isnan(value) else f"{value:.3f}"


def _number(value: float | None) -> str:
    return NONE if value is None else number(value)
