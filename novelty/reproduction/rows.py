"""The rows behind the report: one per pair, analysis and method, as CSV and Parquet."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from novelty.evaluation import Interval, Scores, t_interval
from novelty.io import replacing, write_text
from novelty.reproduction.methods import Method


@dataclass(frozen=True)
class Row:
    """What one method scored on one pair; NaN where not defined.

    Attributes:
        experiment: Name of the experiment.
        case: Its condition.
        repetition: Counted from 0; the cases of one repetition differ in the condition only.
        seed: Of the simulation.
        analysis: Which part of the data, under which settings.
        method: `Method.key`.
        order: K, where it was prescribed; 0 where MDL chose it.
        components: Components of the current scan's mixture.
        points: Points of the current scan.
        changed_points: Those that have changed.
        attainable: Kappa of the best choice of components, knowing the truth; no comparison of components exceeds it.
        distance: Between the two mixtures (eq. 8), in the method's ground distance, m for those as printed.
        true_positives: Novel points that were called novel; the counts are those of section 3.1.
        chi2: Of the table.
        p_value: Of chi2.
        cramers_v: V.
        uncertainty: U.
        kappa: Index of agreement.
        level: Level of agreement (Table 1).
        preprocess: Seconds per pair, like all stages that follow.
        varied: What the experiment varies over its cases, as text.
    """

    experiment: str
    case: str
    repetition: int
    seed: int
    varied: str
    analysis: str
    method: str
    order: int
    components: int
    points: int
    changed_points: int
    attainable: float
    distance: float
    true_positives: int
    false_negatives: int
    false_positives: int
    true_negatives: int
    chi2: float
    p_value: float
    cramers_v: float
    uncertainty: float
    kappa: float
    level: str
    precision: float
    recall: float
    f1: float
    iou: float
    preprocess: float
    register: float
    fit: float
    compare: float
    segment: float

    @property
    def seconds(self) -> float:
        """Of all stages."""
        return self.preprocess + self.register + self.fit + self.compare + self.segment


STAGES = ("preprocess", "register", "fit", "compare", "segment")


def scored_fields(scores: Scores) -> dict[str, Any]:
    """The fields of a row that say how good an answer is."""
    flat = scores.to_dict()
    return {field.name: flat[field.name] for field in fields(Row) if field.name in flat}


def write_rows(folder: Path, name: str, rows: Sequence[Any]) -> None:
    """Write `name.csv` and `name.parquet`; NaN is an empty field in CSV.

    Args:
        folder: Where to.
        name: Of the files.
        rows: Instances of one dataclass.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    flat = [asdict(row) for row in rows]
    buffer = io.StringIO(newline="")
    writer = csv.DictWriter(buffer, [field.name for field in fields(rows[0])], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: "" if _is_nan(value) else value for key, value in row.items()} for row in flat)
    write_text(folder / f"{name}.csv", buffer.getvalue())
    with replacing(folder / f"{name}.parquet") as temporary:
        pq.write_table(pa.Table.from_pylist(flat), temporary)


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


def interval(rows: Iterable[Row], column: str = "kappa") -> Interval:
    """Mean of kappa, or of another column between -1 and 1, with Student's interval at 95 %, cut to that range."""
    return _within(t_interval([getattr(row, column) for row in rows]), 1.0)


def _within(span: Interval, most: float) -> Interval:
    """The interval cut to values of this size at most."""
    return replace(span, low=max(-most, span.low), high=min(most, span.high)) if span.count > 1 else span


def matching(rows: Iterable[Row], **wanted: Any) -> list[Row]:
    """The rows whose columns have these values."""
    return [row for row in rows if all(getattr(row, key) == value for key, value in wanted.items())]


def grouped(rows: Iterable[Row], key: Callable[[Row], Any]) -> dict[Any, list[Row]]:
    """Rows by a key, in the order of first appearance."""
    groups: dict[Any, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def order_curve(rows: Iterable[Row], experiment: str, method: Method) -> dict[int, Interval]:
    """Mean kappa and its interval over the maps at every prescribed K."""
    part = [row for row in matching(rows, experiment=experiment, method=method.key) if row.order]
    return {order: interval(matching(part, order=order)) for order in sorted({row.order for row in part})}


def paired_difference(
    first: Iterable[Row], second: Iterable[Row], same: Sequence[str], column: str = "kappa"
) -> Interval:
    """Mean of first minus second over the pairs of rows that agree in the columns `same`."""
    others: Mapping[Any, float] = {_place(row, same): getattr(row, column) for row in second}
    both = [(getattr(row, column), others[_place(row, same)]) for row in first if _place(row, same) in others]
    return _within(t_interval([a - b for a, b in both]), 2.0)


def _place(row: Row, same: Sequence[str]) -> tuple[Any, ...]:
    return tuple(getattr(row, name) for name in same)
