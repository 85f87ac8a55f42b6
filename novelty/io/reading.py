"""`read_scan`: the registry of readers by file extension, and what all of them need checked first."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from pathlib import Path

from numpy.typing import ArrayLike

from novelty.errors import InputError
from novelty.io.address import MARK, ScanAddress
from novelty.io.columns import no_points
from novelty.io.e57 import read_e57
from novelty.io.kitti import read_bin
from novelty.io.las import read_las
from novelty.io.npy import read_npy, read_npz
from novelty.io.pcd import read_pcd
from novelty.io.ply import read_ply
from novelty.io.poses import Poses
from novelty.io.rosbag import read_rosbag
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
    ".bin": read_bin,
}
"""A new format is one new file with one reader, and one line here."""

PART_READERS: dict[str, Callable[[Path, str], Scan]] = {
    ".e57": read_e57,
    ".bag": read_rosbag,
    ".mcap": read_rosbag,
    ".db3": read_rosbag,
}
"""Formats whose files hold several scans: what follows `#` in the path says which."""

ROS2_BAG = "metadata.yaml"
"""The file that makes a folder a ROS 2 bag."""


def read_scan(
    path: str | Path, origin: ArrayLike | None = None, poses: Poses | str | Path | None = None
) -> Scan:
    """Read one scan; its format follows from the extension.

    Points keep their order and their count, missing returns (NaN) included.

    Args:
        path: A file with one of the extensions of `READERS` or `PART_READERS`, or the folder of a ROS 2 bag. In a
            file of several scans, `#` and its part name one: `survey.e57#2`, `drive.bag#/points:120`.
        origin: Where the sensor stood, (3,) or (N, 3); takes the place of an origin stored in the file.
        poses: Poses of the sequence the scan belongs to, which bring its points into the frame of the sequence.

    Raises:
        InputError: The file is missing, unreadable, damaged or empty, or its format is not known.
        MissingDependencyError: A library that the format needs cannot be loaded.
    """
    address = ScanAddress.parse(path)
    reader = _find_reader(address)
    try:
        if address.file.stat().st_size == 0:
            raise InputError(f"{address.file}: the file is empty (0 bytes). Copy it again.")
        scan = reader(address.file)
    except OSError as error:
        raise InputError(f"{address.file}: the file cannot be read: {error.strerror or error}.") from error
    if scan.num_points == 0:
        raise no_points(address.file)
    if poses is not None:
        scan = (poses if isinstance(poses, Poses) else Poses.read(poses)).place(scan, address.file)
    return scan if origin is None else Scan(scan.points, origin, scan.labels, scan.name)


def has_scan_extension(path: str | Path) -> bool:
    """Whether a file is of a format that `read_scan` reads."""
    return ScanAddress.parse(path).file.suffix.lower() in {*READERS, *PART_READERS}


def is_scan(path: str | Path) -> bool:
    """Whether there is a file, or the folder of a ROS 2 bag, at a scan's address."""
    file = ScanAddress.parse(path).file
    return file.is_file() or (file / ROS2_BAG).is_file()


def _find_reader(address: ScanAddress) -> Callable[[Path], Scan]:
    file = address.file
    if file.is_dir() and not (file / ROS2_BAG).is_file():
        raise InputError(f"{file}: expected a scan file, found a folder. Name one of the files in it.")
    if not file.exists():
        raise InputError(f"{file}: there is no such file.{_did_you_mean(file.name, _siblings(file))}")
    extension = file.suffix.lower()
    if file.is_dir() or extension in PART_READERS:
        read_part = read_rosbag if file.is_dir() else PART_READERS[extension]
        return lambda path: read_part(path, address.part)
    if extension == ".safetensors":
        raise InputError(
            f"{file}: expected a scan, found a map; a map comes first: `novelty detect MAP CUR`."
        )
    if extension not in READERS:
        known = [*READERS, *PART_READERS]
        raise InputError(
            f"{file}: the format {extension or 'without an extension'!r} is not known; known are "
            f"{', '.join(known)}.{_did_you_mean(extension, known)}"
        )
    if address.part:
        raise InputError(f"{address}: a {extension} file holds one scan; leave out {MARK + address.part!r}.")
    return READERS[extension]


def _siblings(file: Path) -> list[str]:
    return [entry.name for entry in file.parent.iterdir()] if file.parent.is_dir() else []


def _did_you_mean(name: str, known: list[str]) -> str:
    nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f" Did you mean {nearest[0]!r}?" if nearest else ""
