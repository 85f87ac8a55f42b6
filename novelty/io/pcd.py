"""PCD (Point Cloud Library): ASCII and binary bodies in numpy, compressed ones with Open3D.

Open3D does not tell the VIEWPOINT, fills the missing lines of an ASCII file with zeros, and refuses
coordinates of different types; so the header is read here and says what must follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.io.columns import cut_short, no_points, scan_from_columns
from novelty.io.open3d_library import load_open3d
from novelty.io.text import read_table
from novelty.scan import Scan

NUMPY_KINDS = {"F": "f", "I": "i", "U": "u"}
ENCODINGS = ("ascii", "binary", "binary_compressed")


@dataclass(frozen=True)
class _Header:
    """What the header says, and where the body begins."""

    row_type: np.dtype[np.void]
    num_points: int
    viewpoint: NDArray[np.float64]
    encoding: str
    num_bytes: int
    num_lines: int


def read_pcd(path: Path) -> Scan:
    """Read a PCD file; its VIEWPOINT is the origin, unless it is all zeros: then the origin is unknown.

    Missing returns of an organised cloud (NaN) keep their place. The field `label` is the ground truth.

    Raises:
        InputError: The header is damaged or lacks x, y and z, or the file is cut short.
        MissingDependencyError: The file is compressed and Open3D cannot be loaded.
    """
    content = path.read_bytes()
    header = _parse_header(content, path)
    if header.num_points == 0:
        raise no_points(path)
    read_columns = {"ascii": _ascii, "binary": _binary, "binary_compressed": _compressed}[header.encoding]
    columns = read_columns(content, header, path)
    return scan_from_columns(columns, path, header.viewpoint if header.viewpoint.any() else None)


def _ascii(content: bytes, header: _Header, path: Path) -> dict[str, NDArray[np.generic]]:
    table = read_table(path, header.num_lines + 1, header.num_points)
    counts = [_num_values(header.row_type[name]) for name in _names(header)]
    if table.shape[1] != sum(counts):
        raise InputError(
            f"{path}, line {header.num_lines + 1}: the header announces {sum(counts)} numbers per point, "
            f"found {table.shape[1]}."
        )
    starts = np.cumsum([0, *counts[:-1]])
    return {name: table[:, start] for name, start in zip(_names(header), starts, strict=True)}


def _binary(content: bytes, header: _Header, path: Path) -> dict[str, NDArray[np.generic]]:
    found = (len(content) - header.num_bytes) // header.row_type.itemsize
    if found < header.num_points:
        raise cut_short(path, header.num_points, found)
    rows = np.frombuffer(content, header.row_type, header.num_points, header.num_bytes)
    return {name: rows[name] for name in _names(header)}


def _compressed(content: bytes, header: _Header, path: Path) -> dict[str, NDArray[np.generic]]:
    """Leave LZF to Open3D, after making sure that all its bytes are there."""
    sizes = np.frombuffer(content[header.num_bytes : header.num_bytes + 8], "<u4")
    if len(sizes) < 2 or len(content) < header.num_bytes + 8 + int(sizes[0]):
        raise cut_short(path, header.num_points, 0)
    open3d = load_open3d()
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        cloud = open3d.t.io.read_point_cloud(str(path), remove_nan_points=False, remove_infinite_points=False)
    positions = cloud.point.positions.numpy() if "positions" in cloud.point else np.empty((0, 3))
    if len(positions) != header.num_points:
        raise InputError(
            f"{path}: the compressed points cannot be decoded; the file is damaged. Copy it again."
        )
    columns = dict(zip("xyz", positions.T, strict=True))
    if "label" in cloud.point:
        columns["label"] = cloud.point["label"].numpy()[:, 0]
    return columns


def _parse_header(content: bytes, path: Path) -> _Header:
    start = content.find(b"DATA ")
    end = content.find(b"\n", start)
    if start < 0 or end < 0:
        raise InputError(f"{path}: expected a PCD file, whose header ends with a line 'DATA'; found none.")
    lines = content[:end].decode("latin-1").splitlines()
    entries = {
        words[0]: words[1:] for words in map(str.split, lines) if words and not words[0].startswith("#")
    }
    try:
        num_points = int(entries["POINTS"][0]) if "POINTS" in entries else _grid_size(entries)
        viewpoint = np.array(entries.get("VIEWPOINT", ["0"] * 7)[:3], dtype=np.float64)
        if num_points < 0 or not np.isfinite(viewpoint).all():
            raise ValueError("POINTS or VIEWPOINT")
        row_type = _row_type(entries)
        (encoding,) = entries["DATA"]
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise InputError(
            f"{path}: the PCD header is damaged ({error}); expected FIELDS, SIZE, TYPE, POINTS, DATA."
        ) from None
    if encoding not in ENCODINGS:
        raise InputError(f"{path}: PCD data must be one of {', '.join(ENCODINGS)}; found {encoding!r}.")
    return _Header(row_type, num_points, viewpoint, encoding, end + 1, len(lines))


def _grid_size(entries: dict[str, list[str]]) -> int:
    return int(entries["WIDTH"][0]) * int(entries.get("HEIGHT", ["1"])[0])


def _row_type(entries: dict[str, list[str]]) -> np.dtype[np.void]:
    """The type of one point; fields named `_` are padding and may repeat, so they are numbered."""
    fields = entries["FIELDS"]
    names = [f"{name}@{place}" if name == "_" else name for place, name in enumerate(fields)]
    kinds = [
        f"<{NUMPY_KINDS[kind]}{size}" for kind, size in zip(entries["TYPE"], entries["SIZE"], strict=True)
    ]
    counts = [int(count) for count in entries.get("COUNT", ["1"] * len(fields))]
    shapes = [() if count == 1 else (count,) for count in counts]
    return np.dtype(list(zip(names, kinds, shapes, strict=True)))


def _names(header: _Header) -> tuple[str, ...]:
    return header.row_type.names or ()


def _num_values(field: np.dtype[np.generic]) -> int:
    return int(np.prod(field.shape, dtype=int))
