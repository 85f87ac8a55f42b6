"""Units of length in which scans are given."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from novelty.errors import ConfigError

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Length of each unit, m."""

WIDEST = 500.0
"""Terrestrial scans that are wider than this and sparser than `SPARSEST` are more likely in another unit, m."""

SPARSEST = 1.0
"""Distance between neighbouring points that no sensor of rooms, streets or robots leaves, m."""


def metres_per(unit: str) -> float:
    """Length of `unit`, m.

    Raises:
        ConfigError: The unit is not in the table.
    """
    try:
        return METRES[unit]
    except KeyError:
        raise ConfigError(f"unit must be one of {', '.join(METRES)}; got {unit!r}.") from None


def doubt_of_metres(points: NDArray[np.float64], spacing: float) -> str | None:
    """A note where coordinates read as metres are hardly metres, None where they may be.

    A room in millimetres is kilometres wide and metres lie between its points; an outdoor scan may be as wide, but is
    denser, and where it lies on the map does not matter.

    Args:
        points: (N, 3), m.
        spacing: Typical distance between neighbours, m.
    """
    if not len(points) or not spacing > SPARSEST:
        return None
    # A few far returns do not make a scene wide.
    low, high = np.percentile(points[:: max(1, len(points) // 10_000)], [1, 99], axis=0)
    width = float((high - low).max())
    if width <= WIDEST:
        return None
    return (
        f"The scene is {width:.0f} m wide and its points are {spacing:.1f} m apart; "
        f"if coordinates are millimetres, pass --unit mm."
    )
