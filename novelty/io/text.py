"""Tables of numbers in text files: XYZ, PTS, TXT, ASC, CSV, and the bodies of ASCII PLY and PCD files.

Open3D reads these formats in float32, which loses 3 cm at 5e5 m, and returns uninitialised points when a PTS
file is cut short; numpy reads them in float64, faster, and a damaged line is found and named.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.io.columns import cut_short, no_points, scan_from_columns
from novelty.scan import Scan

COMMENT_MARKS = ("#", "//", "%")


@dataclass(frozen=True)
class _Layout:
    """Where the numbers begin (lines count from 1), and what separates and names them."""

    first_line: int
    delimiter: str | None
    names: tuple[str, ...]


def read_xyz(path: Path) -> Scan:
    """Read a text file with one point per line: x, y, z, then any further columns.

    Columns are separated by blanks, commas or semicolons. A first line of names (`x y z label`, also after
    `#` or `//`) says which columns to take; without one, the first three are the coordinates.

    Raises:
        InputError: A line is not made of numbers or has another number of columns; there is no point.
    """
    layout = _find_layout(path)
    table = read_table(path, layout.first_line, delimiter=layout.delimiter)
    names = layout.names or ("x", "y", "z")
    if table.shape[1] < len(names):
        raise InputError(
            f"{path}, line {layout.first_line}: expected at least {len(names)} columns ({', '.join(names)}), "
            f"found {table.shape[1]}."
        )
    return scan_from_columns(dict(zip(names, table.T, strict=False)), path)


def read_pts(path: Path) -> Scan:
    """Read a PTS file: the number of points on the first line (optional), then x, y, z and more on each line.

    Raises:
        InputError: As for `read_xyz`, or the file holds another number of points than its first line says.
    """
    first = _split(next(iter(_lines(path)), ""), None)
    if len(first) != 1:
        return read_xyz(path)
    if not first[0].isdigit():
        raise InputError(f"{path}, line 1: expected the number of points or a point, found {first[0]!r}.")
    table = read_table(path, first_line=2, num_rows=int(first[0]))
    if table.shape[1] < 3:
        raise InputError(f"{path}, line 2: expected at least 3 columns (x, y, z), found {table.shape[1]}.")
    return scan_from_columns(dict(zip("xyz", table.T, strict=False)), path)


def read_table(
    path: Path, first_line: int, num_rows: int | None = None, delimiter: str | None = None
) -> NDArray[np.float64]:
    """Read lines of equally many numbers, in float64.

    Args:
        path: The file.
        first_line: The line on which the numbers begin, counted from 1.
        num_rows: How many rows there must be; None takes all there are.
        delimiter: What separates two numbers; None for blanks.

    Returns:
        The numbers, (rows, columns).

    Raises:
        InputError: There is no row, fewer than `num_rows`, or a damaged line, which the message names.
    """
    if next(_rows(path, first_line, delimiter), None) is None:
        raise no_points(path)
    try:
        table = np.loadtxt(
            path,
            delimiter=delimiter,
            skiprows=first_line - 1,
            max_rows=num_rows,
            comments="#",
            ndmin=2,
            encoding="utf-8-sig",
        )
    except ValueError as error:
        rows = islice(_rows(path, first_line, delimiter), num_rows)
        raise InputError(f"{path}{_describe_damage(rows) or f': {error}'}.") from None
    if num_rows is not None and len(table) < num_rows:
        raise cut_short(path, num_rows, len(table))
    return table


def _find_layout(path: Path) -> _Layout:
    """Skip comments and a line of column names; tell the separator from the first line of numbers."""
    names: tuple[str, ...] = ()
    for number, line in enumerate(_lines(path), start=1):
        text = line.strip()
        if not text:
            continue
        delimiter = next((mark for mark in ",;" if mark in text), None)
        fields = _split(text.lstrip("#/% "), delimiter)
        if {"x", "y", "z"} <= {field.lower() for field in fields}:
            names = tuple(field.lower() for field in fields)
        elif _names_columns(fields) and not text.startswith(COMMENT_MARKS):
            found = ", ".join(fields)
            raise InputError(
                f"{path}, line {number}: expected names of columns with x, y and z among them, found {found}."
            )
        elif not text.startswith(COMMENT_MARKS):
            return _Layout(number, delimiter, names)
    raise no_points(path)


def _names_columns(fields: list[str]) -> bool:
    """Whether a line is as long as a point and holds no number."""
    return len(fields) >= 3 and not any(map(_is_number, fields))


def _describe_damage(rows: Iterable[tuple[int, list[str]]]) -> str | None:
    """Describe the first line that is not like the others; None where every line is in order."""
    num_columns = None
    for number, fields in rows:
        wrong = next((field for field in fields if not _is_number(field)), None)
        if wrong is not None:
            return f", line {number}: expected numbers, found {wrong[:40]!r}"
        num_columns = num_columns or len(fields)
        if len(fields) != num_columns:
            return f", line {number}: expected {num_columns} columns as above, found {len(fields)}"
    return None


def _rows(path: Path, first_line: int, delimiter: str | None) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the fields of every line that is neither blank nor a comment."""
    for number, line in enumerate(_lines(path), start=1):
        text = line.partition("#")[0].strip() if number >= first_line else ""
        if text:
            yield number, _split(text, delimiter)


def _lines(path: Path) -> Iterator[str]:
    try:
        with path.open(encoding="utf-8-sig") as lines:
            yield from lines
    except UnicodeDecodeError:
        raise InputError(f"{path}: expected a text file, found binary data. Check the extension.") from None


def _split(text: str, delimiter: str | None) -> list[str]:
    return [field.strip() for field in text.split(delimiter)]


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True
