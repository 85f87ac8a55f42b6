"""Rows of scores as a file, CSV or JSON."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from novelty.cli.scoring import COLUMNS, ScoredPair
from novelty.environment import machine, versions
from novelty.io import write_json, write_text


def write_rows(path: Path, rows: Sequence[ScoredPair]) -> None:
    """Write one row per pair and detector; NaN is an empty field in CSV and null in JSON."""
    flat = [_flat(row) for row in rows]
    if path.suffix == ".json":
        write_json(path, {"rows": flat, "versions": versions(), "machine": machine()})
    else:
        write_text(path, _as_csv(flat))


def _flat(row: ScoredPair) -> dict[str, Any]:
    values = {key: row.values.get(key, math.nan) for key in COLUMNS}
    return {"name": row.name, "detector": row.detector, **values, "failure": row.failure}


def _as_csv(rows: Sequence[dict[str, Any]]) -> str:
    buffer = io.StringIO(newline="")
    writer = csv.DictWriter(buffer, ["name", "detector", *COLUMNS, "failure"], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow(
            {
                key: "" if isinstance(value, float) and math.isnan(value) else value
                for key, value in row.items()
            }
        )
    return buffer.getvalue()
