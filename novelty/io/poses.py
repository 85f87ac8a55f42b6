"""Where the sensor stood for each scan of a sequence: KITTI odometry poses (3 x 4) and TUM trajectories.

A pose takes points from the sensor's frame into the frame of the sequence, in which any two scans can be compared.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.io.text import read_table
from novelty.scan import Scan

KITTI_COLUMNS, TUM_COLUMNS = 12, 8
"""Numbers per line: the rows of a 3 x 4 matrix; or time, x, y, z and the quaternion x, y, z, w."""

LARGEST_GAP = 0.05
"""Seconds between a scan and its pose at most."""

CALIBRATION = "calib.txt"
"""KITTI's file that says how the laser scanner sits on the camera, whose poses KITTI gives."""


@dataclass(frozen=True, eq=False)
class Poses:
    """The poses of a sequence of scans.

    Attributes:
        path: Where they were read.
        matrices: (P, 4, 4) from the sensor's frame to the sequence's, or, for KITTI, those of the camera.
        times: (P,) seconds; None where the file has none.
    """

    path: Path
    matrices: NDArray[np.float64]
    times: NDArray[np.float64] | None = None

    @classmethod
    def read(cls, path: str | Path) -> Poses:
        """Read a file of poses; twelve numbers on a line are KITTI's, eight are TUM's.

        Raises:
            InputError: The file is missing or damaged, or a line is not a rigid motion.
        """
        file = Path(path)
        if not file.is_file():
            raise InputError(f"{file}: there is no such file of poses.")
        table = read_table(file, first_line=1)
        if table.shape[1] == TUM_COLUMNS:
            return cls(file, _rigid(_from_tum(table[:, 1:]), file), table[:, 0])
        if table.shape[1] == KITTI_COLUMNS:
            return cls(file, _rigid(_homogeneous(table), file))
        raise InputError(
            f"{file}: expected {KITTI_COLUMNS} numbers per line (KITTI, a 3 x 4 matrix) or {TUM_COLUMNS} (TUM, "
            f"time x y z qx qy qz qw); found {table.shape[1]}."
        )

    def place(self, scan: Scan, file: Path) -> Scan:
        """Bring a scan into the frame of the sequence; where its origin is unknown, the pose says it.

        Args:
            scan: In the sensor's frame.
            file: The file of the scan, which tells which pose is its own.

        Raises:
            InputError: The file has no pose.
        """
        pose = self.of(file)
        rotation, translation = pose[:3, :3], pose[:3, 3]
        origin = np.zeros(3) if scan.origin is None else scan.origin
        return Scan(
            scan.points @ rotation.T + translation, origin @ rotation.T + translation, scan.labels, scan.name
        )

    def of(self, file: Path) -> NDArray[np.float64]:
        """The pose (4, 4) of the scan in a file.

        As many scans in its folder as poses belong together in their order. Of fewer scans, each has the pose of
        the time that is its name, or else of the line, counted from 0, whose number ends its name.

        Raises:
            InputError: No pose can be told from the name and the folder.
        """
        pose = self.matrices[self._row(file)]
        calibration = _calibration(self.path, file) if self.times is None else None
        if calibration is None:
            return pose
        return np.linalg.inv(calibration) @ pose @ calibration

    def _row(self, file: Path) -> int:
        scans = scans_like(file, besides=self.path)
        if len(scans) == len(self.matrices) and file in scans:
            return scans[file]
        time = _time(file.stem)
        if self.times is not None and time is not None:
            row = int(np.abs(self.times - time).argmin())
            if abs(self.times[row] - time) <= LARGEST_GAP:
                return row
        elif (number := number_of(file)) is not None and number < len(self.matrices):
            return number
        raise InputError(
            f"{file}: {self.path} has no pose for it. Expected as many scans in the folder as poses (found "
            f"{len(scans)} and {len(self.matrices)}), or a name that is the time of a pose within {LARGEST_GAP} s, "
            f"or one that ends in the number of its line, from 0 to {len(self.matrices) - 1}."
        )


def scans_like(file: Path, besides: Path | None = None) -> dict[Path, int]:
    """The numbered files in the folder of a scan with the same extension, in the order of their numbers.

    Args:
        file: One of them.
        besides: A file that is none of them, though it may look like it.

    Returns:
        The place of every file, counted from 0.
    """
    return _places(file.parent, file.suffix, besides, file.parent.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _places(folder: Path, suffix: str, besides: Path | None, _changed: int) -> dict[Path, int]:
    """Remembered until the folder changes: every scan of a sequence asks."""
    files = [entry for entry in folder.iterdir() if entry.suffix == suffix and entry != besides]
    numbered = sorted((entry for entry in files if number_of(entry) is not None), key=_sort_key)
    return {entry: place for place, entry in enumerate(numbered)}


def number_of(file: Path) -> int | None:
    """The whole number that ends the name of a scan; None where there is none."""
    digits = re.search(r"\d+$", _stem(file))
    return int(digits[0]) if digits else None


def _sort_key(file: Path) -> tuple[float, int, str]:
    time = _time(file.stem)
    return (0.0 if time is None else time, number_of(file) or 0, file.name)


def _stem(file: Path) -> str:
    return file.stem.removesuffix(".pcd")


def _time(stem: str) -> float | None:
    """Seconds, where a name is a time: seconds since 1970, or nanoseconds."""
    if re.fullmatch(r"\d{16,}", stem):
        return int(stem) * 1e-9
    return float(stem) if re.fullmatch(r"\d{9,}|\d+\.\d+", stem) else None


def _from_tum(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Position and quaternion (x, y, z, w), (P, 7), as matrices (P, 4, 4)."""
    from scipy.spatial.transform import Rotation

    matrices = np.tile(np.eye(4), (len(table), 1, 1))
    length = np.linalg.norm(table[:, 3:], axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        quaternions = np.where(length > 0, table[:, 3:] / length, np.nan)
    usable = np.isfinite(quaternions).all(axis=1)
    matrices[usable, :3, :3] = Rotation.from_quat(quaternions[usable]).as_matrix()
    matrices[~usable] = np.nan
    matrices[:, :3, 3] = table[:, :3]
    return matrices


def _homogeneous(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of 12 numbers, (P, 12), as matrices (P, 4, 4)."""
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    matrices[:, :3] = rows.reshape(-1, 3, 4)
    return matrices


def _rigid(matrices: NDArray[np.float64], file: Path) -> NDArray[np.float64]:
    """Make sure that every pose is a rotation and a translation.

    Raises:
        InputError: One is not; the message names it.
    """
    defined = np.isfinite(matrices.sum(axis=(1, 2)))[:, None, None]
    rotations = np.where(defined, matrices[:, :3, :3], 0)
    straight = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) < 1e-3
    wrong = np.flatnonzero(~straight | (np.linalg.det(rotations) <= 0))
    if len(wrong):
        raise InputError(f"{file}: pose {wrong[0]}, counted from 0, is not a rotation and a translation.")
    return matrices


def _calibration(poses: Path, scan: Path) -> NDArray[np.float64] | None:
    """From the scanner's frame to the camera's, (4, 4), where KITTI's calibration lies beside poses or scans."""
    folders = (poses.parent, scan.parent, scan.parent.parent)
    file = next((folder / CALIBRATION for folder in folders if (folder / CALIBRATION).is_file()), None)
    if file is None:
        return None
    entries = dict(line.split(":", 1) for line in file.read_text().splitlines() if ":" in line)
    try:
        values = np.array((entries.get("Tr") or entries["Tr_velo_to_cam"]).split(), dtype=np.float64)
        return _rigid(_homogeneous(values[None]), file)[0]
    except (KeyError, ValueError):
        raise InputError(
            f"{file}: expected a line 'Tr:' of {KITTI_COLUMNS} numbers, which places the laser scanner on the camera "
            "of the poses. Remove the file where the poses are those of the scanner."
        ) from None
