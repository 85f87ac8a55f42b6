"""A depth camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.simulation.sensors.pattern import RayPattern, fewer, unit_vectors


@dataclass(frozen=True)
class PinholeCamera(RayPattern):
    """A camera that looks along x; one line per image row, from the top left pixel.

    Attributes:
        width: Pixels.
        height: Pixels.
        focal_length: Pixels.
    """

    width: int
    height: int
    focal_length: float

    @property
    def neighbour_angle(self) -> float:
        """Radians."""
        return float(1 / self.focal_length)

    def directions(self) -> NDArray[np.float32]:
        """Unit vectors (lines, rays, 3)."""
        y = ((self.width - 1) / 2 - np.arange(self.width)) / self.focal_length
        z = (((self.height - 1) / 2 - np.arange(self.height)) / self.focal_length)[:, None]
        norm = np.sqrt(1 + y**2 + z**2)
        return unit_vectors(1 / norm, y / norm, z / norm)

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each point is in front of the camera and inside the image."""
        x, y, z = points.T
        wide = np.abs(y) * self.focal_length <= x * self.width / 2
        return (x > 0) & wide & (np.abs(z) * self.focal_length <= x * self.height / 2)

    def thinned(self, density: float) -> PinholeCamera:
        """More or fewer pixels in both directions, same angles."""
        factor = np.sqrt(density)
        return PinholeCamera(
            fewer(self.width, factor),
            fewer(self.height, factor),
            self.focal_length * factor,
        )
