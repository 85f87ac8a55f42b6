"""The part of the scene that is examined: a range from the sensor and a band of heights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from novelty.preprocess.settings import Preprocess
from novelty.preprocess.survivors import Survivors
from novelty.preprocess.vertical import up_vector

STEP = "cropped"


def crop(scan: Survivors, settings: Preprocess) -> Survivors:
    """Keep points with min_range <= |p - origin| <= max_range and min_height <= p . up <= max_height."""
    return _crop_height(_crop_range(scan, settings), settings)


def _crop_range(scan: Survivors, settings: Preprocess) -> Survivors:
    low, high = settings.min_range, settings.max_range
    if low is None and high is None:
        return scan
    origins = scan.point_origins
    if origins is None:
        return scan.noted("min_range and max_range were left out because the scan's origin is unknown.")
    return scan.only(_between(np.linalg.norm(scan.points - origins, axis=1), low, high), STEP)


def _crop_height(scan: Survivors, settings: Preprocess) -> Survivors:
    low, high = settings.min_height, settings.max_height
    if low is None and high is None:
        return scan
    return scan.only(_between(scan.points @ up_vector(settings), low, high), STEP)


def _between(values: NDArray[np.float64], low: float | None, high: float | None) -> NDArray[np.bool_]:
    inside = np.ones(len(values), dtype=bool)
    if low is not None:
        inside &= values >= low
    if high is not None:
        inside &= values <= high
    return inside
