"""The tables of a report: columns and rows of text, ready to be set."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty.evaluation import METRICS, LabelledScores
from novelty.preprocess.units import metres_per
from novelty.result import Change, NoveltyResult, ObjectRecord, PointState
from novelty.scan import ScanPair


@dataclass(frozen=True)
class Column:
    """A column: its heading, and whether it holds numbers, which are set to the right."""

    name: str
    numeric: bool = True


@dataclass(frozen=True)
class Row:
    """A row of text; `mark` is the style that sets it apart, empty for none."""

    cells: tuple[str, ...]
    mark: str = ""


@dataclass(frozen=True)
class Table:
    """Columns and rows; every row has one cell per column."""

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]

    def first(self, count: int) -> Table:
        """The first rows."""
        return Table(self.columns, self.rows[:count])

    def without(self, *names: str) -> Table:
        """The table without the columns whose names begin so."""
        kept = [place for place, column in enumerate(self.columns) if not column.name.startswith(names)]
        rows = (Row(tuple(row.cells[place] for place in kept), row.mark) for row in self.rows)
        return Table(tuple(self.columns[place] for place in kept), tuple(rows))

    def after(self, count: int) -> Table:
        """The rows after the first `count`."""
        return Table(self.columns, self.rows[count:])


def object_table(result: NoveltyResult, unit: str) -> Table:
    """The objects of both directions, largest first; one that was moved stands where it is now, with its way."""
    gone = [record for record in result.removed.objects if record.kind != "moved"]
    objects = sorted([*result.added.objects, *gone], key=lambda record: -record.num_points)
    with_p_value = any(not math.isnan(record.p_value) for record in objects)
    with_motion = any(record.motion is not None for record in objects)
    names = {
        f"extent [{unit}]": True,
        f"centroid [{unit}]": True,
        f"moved by [{unit}]": with_motion,
        "points": True,
        "score": True,
        "p-value": with_p_value,
        "components": True,
    }
    shown = list(names.values())
    rows = []
    for record in objects:
        cells = (
            by_edges(record.extent, unit),
            as_point(record.centroid, unit),
            _way(record, result.removed.objects, unit),
            thousands(record.num_points),
            number(record.score),
            probability(record.p_value),
            ", ".join(str(k) for k in record.components),
        )
        kept = [cell for cell, wanted in zip(cells, shown, strict=True) if wanted]
        rows.append(Row((f"{record.kind} {record.index}", *kept), record.kind))
    columns = (Column(name) for name, wanted in names.items() if wanted)
    return Table((Column("object", numeric=False), *columns), tuple(rows))


def _way(record: ObjectRecord, others: Sequence[ObjectRecord], unit: str) -> str:
    """How far a moved object's middle went, and by how much it was turned."""
    if record.motion is None:
        return ""
    turn, shift = record.motion[:3, :3], record.motion[:3, 3]
    before = others[record.counterpart].centroid
    angle = math.degrees(math.acos(min(1.0, max(-1.0, (np.trace(turn) - 1) / 2))))
    return f"{_length(float(np.linalg.norm(turn @ before + shift - before)), unit)}, {angle:.0f}°"


def component_table(change: Change, unit: str) -> Table:
    """Every component of one scan, the novel ones first, and what the detector made of it."""
    columns = (
        Column("component", numeric=False),
        Column("weight"),
        Column("points"),
        Column(f"mean [{unit}]"),
        Column(f"std [{unit}]"),
        Column("score"),
        Column("why", numeric=False),
    )
    ordered = sorted(change.components, key=lambda record: (not record.novel, record.index))
    rows = tuple(
        Row(
            (
                f"{record.index}{' · novel' if record.novel else ''}",
                f"{record.weight:.3f}",
                thousands(record.num_points),
                as_point(record.mean, unit),
                by_edges(np.sqrt(np.maximum(np.linalg.eigvalsh(record.covariance)[::-1], 0)), unit),
                number(record.score),
                record.reason,
            ),
            "novel" if record.novel else "",
        )
        for record in ordered
    )
    return Table(columns, rows)


def score_table(scores: Mapping[str, LabelledScores]) -> Table:
    """One row per direction, one column per metric."""
    columns = (Column("", numeric=False), *(Column(metric.name.replace("_", " ")) for metric in METRICS))
    written = {metric.name: probability if metric.name == "p_value" else number for metric in METRICS}
    rows = [
        Row(
            (direction, *(write(getattr(labelled.scores, name)) for name, write in written.items())),
            direction,
        )
        for direction, labelled in scores.items()
    ]
    seen_once = [number(labelled.seen_once_called_novel) for labelled in scores.values()]
    with_last = tuple(Row((*row.cells, share), row.mark) for row, share in zip(rows, seen_once, strict=True))
    return Table((*columns, Column("seen once")), with_last)


def timing_table(timings: Mapping[str, float]) -> Table:
    """Seconds per stage and their sum."""
    rows = [Row((stage.replace("_", " "), f"{seconds:.3f}")) for stage, seconds in timings.items()]
    total = Row(("total", f"{sum(timings.values()):.3f}"), "total")
    return Table((Column("stage", numeric=False), Column("seconds")), (*rows, total))


def point_table(pair: ScanPair, result: NoveltyResult) -> Table:
    """How many points of both scans were given, examined, called novel, and had no counterpart but were not seen."""
    columns = (Column("points", numeric=False), Column("reference"), Column("current"))
    scans = ((pair.reference, result.removed), (pair.current, result.added))
    counts: dict[str, list[int]] = {
        "given": [scan.num_points for scan, _ in scans],
        "examined": [change.num_examined for _, change in scans],
        "novel": [int(change.point_labels.sum()) for _, change in scans],
        "occluded in the other scan": [change.count(PointState.OCCLUDED) for _, change in scans],
        "outside the other scan": [change.count(PointState.UNOBSERVED) for _, change in scans],
    }
    details = [result.details.get(scan, {}).get("points_dropped", {}) for scan in ("reference", "current")]
    for reason in dict.fromkeys(reason for dropped in details for reason in dropped):
        counts[f"left out: {reason}"] = [dropped.get(reason, 0) for dropped in details]
    return Table(columns, tuple(Row((name, *map(thousands, both))) for name, both in counts.items()))


def version_table(entries: Mapping[str, Any]) -> Table:
    """Names and versions."""
    rows = tuple(
        Row((name.replace("_", " "), str(value or "not installed"))) for name, value in entries.items()
    )
    return Table((Column("what", numeric=False), Column("version", numeric=False)), rows)


def number(value: float) -> str:
    """Three significant digits; a dash for NaN."""
    if math.isnan(value):
        return "–"
    if value == 0:
        return "0"
    return f"{value:.3f}" if 0.001 <= abs(value) < 10 else f"{value:.3g}"


def probability(value: float) -> str:
    """Two significant digits, never 0; a dash for NaN."""
    if math.isnan(value):
        return "–"
    return "< 1e-16" if value < 1e-16 else f"{value:.2g}"


def thousands(value: int) -> str:
    """A count with thin groups of three: 12 345."""
    return f"{value:,}".replace(",", " ")


def by_edges(lengths: NDArray[np.float64], unit: str) -> str:
    """Three lengths: 0.45 × 0.40 × 0.02."""
    return " × ".join(_length(value, unit) for value in lengths)


def as_point(position: NDArray[np.float64], unit: str) -> str:
    """Three coordinates, to the centimetre: 1.20, -0.35, 0.80."""
    return ", ".join(f"{value:.{_decimals(unit)}f}" for value in position)


def _length(value: float, unit: str) -> str:
    decimals = _decimals(unit)
    return (
        f"{value:.{decimals}f}"
        if value == 0 or value >= 10 ** (1 - decimals)
        else f"{value:.{decimals + 1}f}"
    )


def _decimals(unit: str) -> int:
    """Decimals that tell centimetres, or less, apart."""
    return max(0, 2 + round(math.log10(metres_per(unit))))
