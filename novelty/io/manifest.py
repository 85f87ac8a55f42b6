"""`pairs.csv`: the list of scan pairs that an evaluation, a sweep or a calibration runs over.

The columns are `name,reference,current`, optionally `reference_origin,current_origin` (where the sensor
stood, as "x y z"), `unit` and `poses` (a file of poses that brings both scans into one frame). Paths are
relative to the file. A folder of scans with poses takes its place: its consecutive scans are the pairs.
"""

from __future__ import annotations

import csv
import difflib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from novelty.errors import InputError, NoveltyError
from novelty.io.pair_entry import PairEntry
from novelty.io.reading import has_scan_extension, is_scan
from novelty.io.sequence import read_sequence
from novelty.scan import ScanPair

REQUIRED_COLUMNS = ("name", "reference", "current")
OPTIONAL_COLUMNS = ("reference_origin", "current_origin", "unit", "poses")
TEXT = (".csv", ".txt")
"""Extensions of scans that a manifest may have."""

COLUMNS = REQUIRED_COLUMNS + OPTIONAL_COLUMNS


@dataclass(frozen=True)
class FailedPair:
    """A pair that could not be read, in its place among the others."""

    name: str
    error: NoveltyError


def read_pairs(path: str | Path) -> tuple[PairEntry, ...]:
    """Read a manifest and make sure, before any work begins, that every line of it can be used.

    Raises:
        InputError: The manifest or a scan it names is missing, or a line is damaged, which the message names.
    """
    entries = []
    for entry in read_entries(path):
        if isinstance(entry, FailedPair):
            raise entry.error
        entries.append(entry)
    return tuple(entries)


def load_pairs(path: str | Path) -> Iterator[ScanPair | FailedPair]:
    """Load the pairs of a manifest one after the other; a bad one is reported in its place.

    Raises:
        InputError: The manifest is missing, or its header is damaged, so that no line can be understood.
    """
    for entry in read_entries(path):
        yield entry if isinstance(entry, FailedPair) else _load(entry)


def _load(entry: PairEntry) -> ScanPair | FailedPair:
    try:
        return entry.load()
    except NoveltyError as error:
        return FailedPair(entry.name, error)


def read_entries(path: str | Path) -> list[PairEntry | FailedPair]:
    """Read a manifest and no scan yet; a line that cannot be used is reported in its place.

    Args:
        path: The manifest, or a folder of scans with poses (see `read_sequence`).

    Raises:
        InputError: The manifest is missing, or its header is damaged, so that no line can be understood.
    """
    path = Path(path)
    if path.is_dir():
        return list(read_sequence(path))
    if is_scan(path) and has_scan_extension(path) and path.suffix.lower() not in TEXT:
        wanted = ", ".join(REQUIRED_COLUMNS)
        raise InputError(f"{path}: expected a manifest, a CSV file with the columns {wanted}; found a scan.")
    rows = _read_rows(path)
    if not rows:
        raise InputError(
            f"{path}: the manifest is empty; its first line must be {','.join(REQUIRED_COLUMNS)}."
        )
    columns = [column.strip() for column in rows[0][1]]
    _check_columns(columns, f"{path}, line {rows[0][0]}")
    if len(rows) == 1:
        raise InputError(f"{path}: the manifest lists no pairs.")
    lines: dict[str, int] = {}
    return [_parse_row(columns, fields, line, path, lines) for line, fields in rows[1:]]


def _parse_row(
    columns: list[str], fields: list[str], line: int, path: Path, lines: dict[str, int]
) -> PairEntry | FailedPair:
    """Make an entry of one line; `lines` remembers on which line each name stands."""
    source = f"{path}, line {line}"
    name = fields[columns.index("name")].strip() if len(fields) == len(columns) else ""
    try:
        _check_row(columns, fields, source)
        if lines.setdefault(name, line) != line:
            raise InputError(f"{source}: the name {name!r} is already used on line {lines[name]}.")
        return _entry(dict(zip(columns, fields, strict=True)), path.parent, source)
    except InputError as error:
        return FailedPair(name or f"line {line}", error)


def _read_rows(path: Path) -> list[tuple[int, list[str]]]:
    """The lines that are not blank, with their numbers, split into fields."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            return [(reader.line_num, row) for row in reader if any(field.strip() for field in row)]
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such manifest.") from None
    except OSError as error:
        raise InputError(f"{path}: the manifest cannot be read: {error.strerror}.") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: expected a CSV file in UTF-8; {error}.") from None


def _check_columns(columns: list[str], source: str) -> None:
    if len(columns) == 1 and ";" in columns[0]:
        raise InputError(f"{source}: columns must be separated by commas, found semicolons.")
    for column in columns:
        if column not in COLUMNS:
            nearest = difflib.get_close_matches(column, COLUMNS, n=1)
            advice = f"did you mean {nearest[0]!r}?" if nearest else f"known are {', '.join(COLUMNS)}."
            raise InputError(f"{source}: the column {column!r} is not known; {advice}")
    missing = [column for column in REQUIRED_COLUMNS if column not in columns]
    if missing:
        raise InputError(f"{source}: the column {missing[0]!r} is missing; found {', '.join(columns)}.")
    if len(set(columns)) < len(columns):
        raise InputError(f"{source}: a column is there twice; found {', '.join(columns)}.")


def _check_row(columns: list[str], fields: list[str], source: str) -> None:
    if len(fields) != len(columns):
        raise InputError(
            f"{source}: expected {len(columns)} fields ({', '.join(columns)}), found {len(fields)}. "
            "Put a field that contains a comma in double quotes."
        )
    empty = [name for name in REQUIRED_COLUMNS if not fields[columns.index(name)].strip()]
    if empty:
        raise InputError(f"{source}: the field {empty[0]!r} is empty.")


def _entry(row: dict[str, str], folder: Path, source: str) -> PairEntry:
    values = {column: field.strip() for column, field in row.items()}
    for column in ("reference", "current"):
        if not is_scan(folder / values[column]):
            raise InputError(
                f"{source}: the {column} scan {values[column]!r} is not a file in {folder.resolve()}."
            )
    if values.get("poses") and not (folder / values["poses"]).is_file():
        raise InputError(f"{source}: the poses {values['poses']!r} are not a file in {folder.resolve()}.")
    return PairEntry(
        name=values["name"],
        reference=folder / values["reference"],
        current=folder / values["current"],
        reference_origin=_origin(values.get("reference_origin", ""), "reference_origin", source),
        current_origin=_origin(values.get("current_origin", ""), "current_origin", source),
        unit=values.get("unit") or None,
        source=source,
        poses=folder / values["poses"] if values.get("poses") else None,
    )


def _origin(text: str, column: str, source: str) -> tuple[float, float, float] | None:
    """Three finite numbers; an empty field is None."""
    if not text:
        return None
    try:
        x, y, z = (float(number) for number in text.split())
    except ValueError:
        raise InputError(f"{source}: {column} must be three numbers 'x y z'; found {text!r}.") from None
    if not np.isfinite([x, y, z]).all():
        raise InputError(f"{source}: {column} must be three finite numbers; found {text!r}.")
    return x, y, z
