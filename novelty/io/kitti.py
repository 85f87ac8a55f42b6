"""KITTI `.bin`: rows of float32 x, y, z and intensity in the frame of the laser scanner, without a header.

nuScenes writes the same with a fifth column, the ring, and calls it `.pcd.bin`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from novelty.errors import InputError
from novelty.scan import Scan

FARTHEST = 1e5
"""m; no laser scanner measures so far, so that a coordinate beyond it shows that the file holds something else."""


def read_bin(path: Path) -> Scan:
    """Read x, y and z; the sensor stood at zero, as this format has it.

    Raises:
        InputError: The size is not that of whole rows, or the numbers are no coordinates.
    """
    columns = 5 if path.name.lower().endswith(".pcd.bin") else 4
    num_bytes = path.stat().st_size
    if num_bytes % (4 * columns):
        raise InputError(
            f"{path}: expected rows of {columns} float32 numbers (x, y, z, intensity{', ring' * (columns == 5)}), "
            f"{4 * columns} bytes each; found {num_bytes} bytes. It is cut short, or another format."
        )
    points = np.fromfile(path, "<f4").reshape(-1, columns)[:, :3]
    with np.errstate(invalid="ignore"):
        strange = np.isfinite(points) & (np.abs(points) > FARTHEST)
    if strange.any():
        row = int(strange.any(axis=1).argmax())
        raise InputError(
            f"{path}: expected float32 coordinates in metres; point {row} is {points[row].tolist()}. "
            "The file is damaged, or holds something else than x, y, z and intensity."
        )
    return Scan(points, origin=np.zeros(3), name=str(path))
