"""The row: what a sweep keeps of one run, that is of one pair under one configuration in one repetition.

`COLUMNS` documents every column; `SCHEMA` is the same for pyarrow, with the descriptions as metadata, so that a shard
explains itself to pandas, polars and duckdb. What is not defined (a score without ground truth, the order of a
mixture that was never fitted) is null, never zero and never NaN.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

METRICS = ("kappa", "cramers_v", "uncertainty", "precision", "recall", "f1", "iou", "mcc")
"""The scores of either direction; `novelty.evaluation.METRICS` describes each."""

COUNTS = ("tp", "fn", "fp", "tn")
"""The contingency table behind them, in points."""

DIRECTIONS = ("added", "removed")
ROLES = ("reference", "current")

STAGES = ("read", "preprocess", "register", "fit", "compare", "segment", "objects")
"""Everything that a run's time goes to, in the order of the work."""

OK, NOTED, FAILED, OUT_OF_MEMORY = "ok", "noted", "failed", "out of memory"
FAILURES = (FAILED, OUT_OF_MEMORY)
"""Values of `status` for a run without an answer."""


@dataclass(frozen=True)
class Column:
    """A column of the row: its type, and what its values are."""

    name: str
    type: pa.DataType
    description: str


def _identity() -> Iterable[Column]:
    yield Column("key", pa.string(), "Hash of pair, inputs, resolved configuration, repetition and code.")
    yield Column("data", pa.string(), "Name of the entry under `data` in the sweep that the pair comes from.")
    yield Column("pair", pa.string(), "Name of the pair, unique within `data`.")
    yield Column(
        "inputs", pa.string(), "Hash of the content of the pair: of both files, or of the simulation."
    )
    yield Column(
        "condition", pa.string(), "JSON: options of the simulation the pair was made with; {} for files."
    )
    yield Column("detector", pa.string(), "Configuration key `detector`.")
    yield Column("max_components", pa.int32(), "Configuration key `max_components`, K_max.")
    yield Column(
        "seed", pa.int64(), "Configuration key `seed` of this run: that of the sweep plus the repetition."
    )
    yield Column("repetition", pa.int32(), "0, 1, ...")
    yield Column(
        "axes", pa.string(), "JSON: the configuration keys that the sweep varies and their values here."
    )
    yield Column(
        "configuration", pa.string(), "JSON: the whole resolved configuration, its seed as in the sweep."
    )


def _outcome() -> Iterable[Column]:
    yield Column("status", pa.string(), f"{OK}, {NOTED} (see `message`), {FAILED} or {OUT_OF_MEMORY}.")
    yield Column(
        "message", pa.string(), "The notes, or why there is no answer; empty when there is nothing to say."
    )
    yield Column("changed", pa.bool_(), "Whether anything changed at all.")
    yield Column("p_value", pa.float64(), "Probability of the evidence if nothing had changed.")
    yield Column("distance", pa.float64(), "Distance between the two mixtures (eq. 8; lengths in metres).")
    for metric in ("kappa", "cramers_v", "uncertainty", "f1", "iou"):
        yield Column(
            metric, pa.float64(), f"Mean of added_{metric} and removed_{metric}; of one where one is null."
        )
    for direction in DIRECTIONS:
        for metric in METRICS:
            yield Column(f"{direction}_{metric}", pa.float64(), f"{metric} of the points called {direction}.")
        for count in COUNTS:
            yield Column(
                f"{direction}_{count}", pa.int64(), f"Points in the cell {count} of the contingency table."
            )
        yield Column(
            f"{direction}_seen_once",
            pa.float64(),
            "Share of the points seen in one scan only (label 2) that was called novel; lower is better.",
        )
        yield Column(f"{direction}_novel_points", pa.int64(), f"Points called {direction}.")
        yield Column(f"{direction}_objects", pa.int32(), f"Objects called {direction}, moved ones included.")


def _mixtures() -> Iterable[Column]:
    for role in ROLES:
        yield Column(f"{role}_points", pa.int64(), "Points of the scan as given.")
        yield Column(f"{role}_cells", pa.int64(), "Cells that the mixture was fitted to.")
        yield Column(f"{role}_components", pa.int32(), "K*, the order of the mixture that was compared.")
        yield Column(f"{role}_mdl", pa.float64(), "Description length of that mixture, nats.")
        yield Column(
            f"{role}_mdl_path",
            pa.list_(pa.float64()),
            "Description length at the orders 1 to K_max, nats; null where an order was not reached.",
        )


def _costs() -> Iterable[Column]:
    for stage in STAGES:
        yield Column(
            f"seconds_{stage}",
            pa.float64(),
            "Wall seconds of the stage; what several runs share is divided among them, so that rows add up.",
        )
    yield Column("seconds", pa.float64(), "Sum over the stages.")
    yield Column("memory", pa.int64(), "Resident memory of the process after the batch, bytes.")
    yield Column("peak_memory", pa.int64(), "Highest resident memory of the process so far, bytes.")
    yield Column("batch", pa.string(), "The batch that the run was computed in.")
    yield Column("batch_runs", pa.int32(), "Runs in that batch.")


def _provenance() -> Iterable[Column]:
    yield Column("attempt", pa.int32(), "1, and one more for every retry after a failure.")
    yield Column("code", pa.string(), "Version of novelty and hash of the source code that computes.")
    yield Column("versions", pa.string(), "JSON: versions of novelty, Python and the libraries.")
    yield Column("machine", pa.string(), "JSON: the computer, as far as it bears on speed.")
    yield Column("worker", pa.string(), "Host and process that computed the run.")
    yield Column("started", pa.timestamp("us", tz="UTC"), "When the batch was begun.")
    yield Column("finished", pa.timestamp("us", tz="UTC"), "When the run was finished.")


COLUMNS: tuple[Column, ...] = (*_identity(), *_outcome(), *_mixtures(), *_costs(), *_provenance())

SCHEMA = pa.schema(
    [pa.field(column.name, column.type, metadata={"description": column.description}) for column in COLUMNS]
)

EXACT = tuple(column.name for column in (*_identity(), *_outcome(), *_mixtures()))
"""The columns that two undisturbed executions of one sweep have in common; the others say what it cost, and where."""


def as_table(rows: Iterable[Mapping[str, Any]]) -> pa.Table:
    """Rows as a table of the schema; absent and NaN values become null.

    Raises:
        pyarrow.ArrowInvalid: A value does not have the type of its column.
    """
    return pa.Table.from_pylist([_without_nan(row) for row in rows], schema=SCHEMA)


def _without_nan(row: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _defined(value) for name, value in row.items()}


def _defined(value: Any) -> Any:
    if isinstance(value, list):
        return [_defined(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
