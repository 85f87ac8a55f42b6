"""Where a sensor's rays go, in its own frame (x forward, y left, z up) and in the order of delivery."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

BORDER = 1e-3
"""How far outside the outermost rays a point still counts as covered, radians."""


class RayPattern(ABC):
    """The rays of one sweep as a grid (lines, rays).

    Attributes:
        neighbour_axis: Axis of the grid along which beams are close enough to overlap.
    """

    neighbour_axis: ClassVar[int] = 1

    @property
    @abstractmethod
    def neighbour_angle(self) -> float:
        """Angle between two rays next to each other along that axis, radians."""

    @abstractmethod
    def directions(self) -> NDArray[np.float32]:
        """Unit vectors (lines, rays, 3)."""

    @abstractmethod
    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each of `points` (N, 3), in the sensor's frame, lies in the field of view: (N,)."""

    @abstractmethod
    def thinned(self, density: float) -> RayPattern:
        """The same field of view with about `density` times as many rays."""


def unit_vectors(
    x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]
) -> NDArray[np.float32]:
    """The grid (lines, rays, 3) of three components that broadcast to (lines, rays)."""
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1).astype(np.float32)


def fewer(count: int, density: float) -> int:
    """`density` times as many lines, two at least."""
    return max(2, round(count * density))
