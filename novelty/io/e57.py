"""E57 (ASTM E2807), with pye57: the stations of a survey in one file, each with its own pose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.io.extras import load_format_library
from novelty.scan import Scan


def read_e57(path: Path, part: str = "") -> Scan:
    """Read all the scans of a file as one, or the one that `part` names, in the coordinates of the file.

    A scan's pose says where its scanner stood; with several, every point has its own origin. Points that the file
    marks as invalid keep their place as missing returns.

    Args:
        path: The file.
        part: Number of the scan, counted from 0; empty for all of them.

    Raises:
        InputError: The file is damaged, or has no such scan.
        MissingDependencyError: pye57 is not installed.
    """
    pye57 = load_format_library("pye57", "E57 files")
    try:
        with pye57.E57(str(path)) as file:
            count = file.scan_count
            chosen = range(count) if not part else [_number(part, count, path)]
            stations = [_station(file, index) for index in chosen]
    except InputError:
        raise
    # libE57Format has its own exceptions, pye57 raises ValueError, KeyError and bare Exception.
    except Exception as error:
        raise InputError(
            f"{path}: pye57 cannot read the file, it is damaged or cut short ({error})."
        ) from error
    if not stations:
        raise InputError(f"{path}: the file contains no scans.")
    name = f"{path}#{part}" if part else str(path)
    return Scan(np.concatenate([points for points, _ in stations]), _origin(stations), name=name)


def _number(part: str, count: int, path: Path) -> int:
    if not part.isdigit() or int(part) >= count:
        raise InputError(
            f"{path}: expected the number of a scan after '#', from 0 to {count - 1}; found {part!r}. "
            "Without '#' all scans of the file are read as one."
        )
    return int(part)


def _station(file: Any, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """The points (N, 3) of one scan and where its scanner stood (3,); None where the file does not say."""
    header = file.get_header(index)
    columns = file.read_scan_raw(index, ignore_unsupported_fields=True)
    points, invalid = _cartesian(columns)
    points[columns.get(invalid, np.zeros(len(points))).astype(bool)] = np.nan
    if not header.has_pose():
        return points, None
    return points @ header.rotation_matrix.T + header.translation, np.asarray(header.translation, dtype=float)


def _cartesian(columns: dict[str, NDArray[Any]]) -> tuple[NDArray[np.float64], str]:
    """Coordinates in the scanner's frame, and the name of the field that marks the invalid ones.

    Raises:
        KeyError: The scan has neither Cartesian nor spherical coordinates.
    """
    if "cartesianX" in columns:
        return np.stack([columns[f"cartesian{axis}"] for axis in "XYZ"], axis=1), "cartesianInvalidState"
    distance, azimuth, elevation = (columns[f"spherical{name}"] for name in ("Range", "Azimuth", "Elevation"))
    level = distance * np.cos(elevation)
    points = np.stack(
        [level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)], axis=1
    )
    return points, "sphericalInvalidState"


def _origin(
    stations: list[tuple[NDArray[np.float64], NDArray[np.float64] | None]],
) -> NDArray[np.float64] | None:
    """One position for one scan, one per point for several; None unless all are known."""
    origins = [origin for _, origin in stations if origin is not None]
    if len(origins) < len(stations):
        return None
    if len(origins) == 1:
        return origins[0]
    return np.repeat(origins, [len(points) for points, _ in stations], axis=0)
