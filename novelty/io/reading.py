"""`read_scan`: the registry of readers by file extension, and what all of them need checked first."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from pathlib import Path

from numpy.typing import ArrayLike

from novelty.errors import InputError
from novelty.io.columns import no_points
from novelty.io.las import read_las
from novelty.io.npy import read_npy, read_npz
from novelty.io.pcd import read_pcd
from novelty.io.ply import read_ply
from novelty.io.text import read_pts, read_xyz
from novelty.scan import Scan

READERS: dict[str, Callable[[Path], Scan]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".xyz": read_xyz,
    ".txt": read_xyz,
    ".asc": read_xyz,
    ".csv": read_xyz,
    ".pts": read_pts,
    ".las": read_las,
    ".laz": read_las,
    ".npy": read_npy,
    ".npz": read_npz,
}
"""A new format is one new file with one reader, and one line here."""


def read_scan(path: str | Path, origin: ArrayLike | None = None) -> Scan:
    """Read one scan; its format follows from the extension.

    Points keep their order and their count, missing returns (NaN) included.

    Args:
        path: A file with one of the extensions of `READERS`.
        origin: Where the sensor stood, (3,) or (N, 3); takes the place of an origin stored in the file.

    Raises:
        InputError: The file is missing, unreadable, damaged or empty, or its format is not known.
        MissingDependencyError: A library that the format needs cannot be loaded.
    """
    file = Path(path)
    reader = _find_reader(file)
    try:
        if file.stat().st_size == 0:
            raise InputError(f"{file}: the file is empty (0 bytes). Copy it again.")
        scan = reader(file)
    except OSError as error:
        raise InputError(f"{file}: the file cannot be read: {error.strerror or error}.") from error
    if scan.num_points == 0:
        raise no_points(file)
    return scan if origin is None else Scan(scan.points, origin, scan.labels, scan.name)


def _find_reader(file: Path) -> Callable[[Path], Scan]:
    if file.is_dir():
        raise InputError(f"{file}: expected a scan file, found a folder. Name one of the files in it.")
    if not file.exists():
        raise InputError(f"{file}: there is no such file.{_did_you_mean(file.name, _siblings(file))}")
    extension = file.suffix.lower()
    if extension not in READERS:
        raise InputError(
            f"{file}: the format {extension or 'without an extension'!r} is not known; known are "
            f"{', '.join(READERS)}.{_did_you_mean(extension, READERS)}"
        )
    return READERS[extension]


def _siblings(file: Path) -> list[str]:
    return [entry.name for entry in file.parent.iterdir()] if file.parent.is_dir() else []


def _did_you_mean(name: str, known: list[str] | dict[str, Callable[[Path], Scan]]) -> str:
    nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f" Did you mean {nearest[0]!r}?" if nearest else ""
