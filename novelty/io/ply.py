"""PLY (Turk's polygon file format), read and written with numpy.

Open3D 0.20 returns uninitialised memory for the missing points of a truncated file, mixes up coordinates of
different types, and drops infinite float32 values on writing, all without an error. Here the header says what
must follow, and what does not follow is an error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.errors import InputError
from novelty.io.atomic import replacing
from novelty.io.columns import cut_short, no_points, scan_from_columns
from novelty.io.text import read_table
from novelty.scan import Scan

PLY_TYPES = {
    **{"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint"},
    **{"f4": "float", "f8": "double"},
}
NUMPY_TYPES = {
    **{name: kind for kind, name in PLY_TYPES.items()},
    **{np.dtype(kind).name: kind for kind in PLY_TYPES},  # int8 ... float64, which newer programs write
}
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    """One element of the header, such as `vertex`: how many rows, and the fields of a row."""

    name: str
    count: int
    fields: list[tuple[str, str]]
    has_list: bool = False


@dataclass(frozen=True)
class _Header:
    encoding: str
    elements: tuple[_Element, ...]
    num_bytes: int
    num_lines: int


def read_ply(path: Path) -> Scan:
    """Read the vertices of a PLY file, ASCII or binary, and its ground truth from the property `label`.

    Raises:
        InputError: The header is not that of a PLY file with x, y and z per vertex, or the file is cut short.
    """
    content = path.read_bytes()
    header = _parse_header(content, path)
    before, vertex = _find_vertex(header, path)
    read_columns = _ascii if header.encoding == "ascii" else _binary
    return scan_from_columns(read_columns(content, header, before, vertex, path), path)


def write_ply(path: str | Path, points: ArrayLike, **vertex_properties: ArrayLike) -> None:
    """Write points and any number of scalars per point as a binary PLY file, all at once or not at all.

    Coordinates are written in float32 where that loses nothing, otherwise in float64. NaN is kept.

    Args:
        path: The file; its folder is made where needed.
        points: (N, 3).
        vertex_properties: One array (N,) per property, of a type that PLY knows: bool (as uchar), integers of
            8, 16 or 32 bits, float32 or float64.

    Raises:
        InputError: There is no point, a length differs, a type or a name cannot be written.
    """
    coordinates = np.asarray(points, dtype=np.float64)
    if coordinates.ndim != 2 or coordinates.shape[1] != 3 or len(coordinates) == 0:
        raise InputError(f"{path}: points must have shape (N, 3) with N > 0; got {coordinates.shape}.")
    columns = dict(zip("xyz", _narrowest(coordinates).T, strict=True))
    for name, values in vertex_properties.items():
        columns[name] = _writable(name, values, len(coordinates), path)
    rows = np.empty(
        len(coordinates), [(name, column.dtype.newbyteorder("<")) for name, column in columns.items()]
    )
    for name, column in columns.items():
        rows[name] = column
    with replacing(path) as temporary:
        temporary.write_bytes(_header_of(columns, len(rows)) + rows.tobytes())


def _header_of(columns: Mapping[str, NDArray[np.generic]], num_points: int) -> bytes:
    properties = (f"property {PLY_TYPES[column.dtype.str[1:]]} {name}" for name, column in columns.items())
    first_lines = ("ply", "format binary_little_endian 1.0", f"element vertex {num_points}")
    return "\n".join((*first_lines, *properties, "end_header\n")).encode("ascii")


def _parse_header(content: bytes, path: Path) -> _Header:
    if not content.startswith(b"ply"):
        raise InputError(f"{path}: expected a PLY file, which begins with 'ply'; found {content[:12]!r}.")
    end = content.find(b"end_header")
    line_end = content.find(b"\n", end)
    if end < 0 or line_end < 0:
        raise InputError(f"{path}: the PLY header has no 'end_header'; the file is cut short or damaged.")
    lines = content[:line_end].decode("latin-1").splitlines()
    encoding, elements = "", []
    for number, line in enumerate(lines, start=1):
        try:
            match line.split():
                case ["format", name, _]:
                    encoding = name
                case ["element", name, count]:
                    elements.append(_Element(name, _count(count), []))
                case ["property", "list", *_]:
                    elements[-1].has_list = True
                case ["property", kind, name]:
                    elements[-1].fields.append((name, NUMPY_TYPES[kind]))
        except (ValueError, IndexError, KeyError):
            raise InputError(
                f"{path}, line {number}: {line.strip()!r} has no place in a PLY header."
            ) from None
    if encoding not in BYTE_ORDERS:
        raise InputError(f"{path}: the format must be one of {', '.join(BYTE_ORDERS)}; found {encoding!r}.")
    return _Header(encoding, tuple(elements), line_end + 1, len(lines))


def _count(text: str) -> int:
    if not text.isdigit():
        raise ValueError(text)
    return int(text)


def _find_vertex(header: _Header, path: Path) -> tuple[tuple[_Element, ...], _Element]:
    """Return the elements before `vertex`, whose size must be known, and `vertex` itself."""
    names = [element.name for element in header.elements]
    if "vertex" not in names:
        raise InputError(f"{path}: the PLY file has no element 'vertex'; found {', '.join(names) or 'none'}.")
    place = names.index("vertex")
    before, vertex = header.elements[:place], header.elements[place]
    if vertex.has_list or (header.encoding != "ascii" and any(element.has_list for element in before)):
        raise InputError(
            f"{path}: list properties in or before the element 'vertex' are not supported; "
            "save the points alone, for example with CloudCompare."
        )
    if len({name for name, _ in vertex.fields}) < len(vertex.fields):
        raise InputError(f"{path}: the header names a property of 'vertex' twice.")
    if vertex.count == 0:
        raise no_points(path)
    return before, vertex


def _ascii(
    content: bytes, header: _Header, before: tuple[_Element, ...], vertex: _Element, path: Path
) -> dict[str, NDArray[np.generic]]:
    first_line = header.num_lines + 1 + sum(element.count for element in before)
    table = read_table(path, first_line, vertex.count)
    names = [name for name, _ in vertex.fields]
    if table.shape[1] != len(names):
        raise InputError(
            f"{path}, line {first_line}: the header announces {len(names)} properties per vertex, "
            f"found {table.shape[1]} numbers."
        )
    return dict(zip(names, table.T, strict=True))


def _binary(
    content: bytes, header: _Header, before: tuple[_Element, ...], vertex: _Element, path: Path
) -> dict[str, NDArray[np.generic]]:
    order = BYTE_ORDERS[header.encoding]
    offset = header.num_bytes + sum(element.count * _row_type(element, order).itemsize for element in before)
    row_type = _row_type(vertex, order)
    if row_type.itemsize == 0:
        return {}
    found = max(len(content) - offset, 0) // row_type.itemsize
    if found < vertex.count:
        raise cut_short(path, vertex.count, found)
    rows = np.frombuffer(content, row_type, vertex.count, offset)
    return {name: rows[name] for name, _ in vertex.fields}


def _row_type(element: _Element, order: str) -> np.dtype[np.void]:
    return np.dtype([(name, order + kind) for name, kind in element.fields])


def _narrowest(points: NDArray[np.float64]) -> NDArray[np.floating]:
    with np.errstate(over="ignore"):
        narrow = points.astype(np.float32)
    return narrow if np.array_equal(narrow, points, equal_nan=True) else points


def _writable(name: str, values: ArrayLike, num_points: int, path: str | Path) -> NDArray[np.generic]:
    column = np.asarray(values)
    if column.dtype == bool:
        column = column.astype(np.uint8)
    if column.shape != (num_points,):
        raise InputError(f"{path}: property {name!r} must have shape ({num_points},); got {column.shape}.")
    if column.dtype.str[1:] not in PLY_TYPES:
        known = ", ".join(np.dtype(kind).name for kind in PLY_TYPES)
        raise InputError(f"{path}: property {name!r} has type {column.dtype}; PLY knows bool, {known}.")
    if name in {"x", "y", "z"} or not (name.isascii() and name.isidentifier()):
        raise InputError(f"{path}: a property of a PLY file cannot be called {name!r}.")
    return column
