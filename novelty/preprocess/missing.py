"""Missing returns, and scans that leave nothing to examine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.preprocess.survivors import Survivors
from novelty.scan import Scan

STEP = "not finite"


def drop_missing(scan: Survivors) -> Survivors:
    """Take out points with a NaN or infinite coordinate; an origin that is not finite counts as unknown."""
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(scan.points).all(axis=1))
    left = scan.only(finite, STEP)
    if left.dropped[STEP]:
        left = left.noted(f"{left.dropped[STEP]} points without finite coordinates were not examined.")
    origins = left.point_origins
    if origins is not None and not np.isfinite(origins).all():
        left = replace(left, origin=None).noted("The origin is not finite and is treated as unknown.")
    return left


def check_scan(scan: Scan) -> None:
    """Refuse a scan about which nothing can be said.

    Raises:
        InputError: There is no point, no finite point, or there is one place only.
    """
    name = f"scan {scan.name!r}" if scan.name else "scan"
    if scan.num_points == 0:
        raise InputError(f"{name}: expected points, found none. Check that the file is complete.")
    finite = scan.points[np.isfinite(scan.points).all(axis=1)]
    if len(finite) == 0:
        raise InputError(
            f"{name}: expected finite coordinates, but each of its {scan.num_points} points has a NaN or an "
            "infinite one. Check the sensor driver or the export."
        )
    if (finite == finite[0]).all():
        where = ", ".join(f"{value:g}" for value in finite[0])
        raise InputError(
            f"{name}: expected points in different places, but all {len(finite)} finite ones are at "
            f"({where}). Check the sensor driver or the export."
        )
