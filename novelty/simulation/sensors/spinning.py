"""A spinning column of beams."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from novelty.simulation.sensors.pattern import BORDER, RayPattern, fewer, unit_vectors


@dataclass(frozen=True)
class SpinningBeams(RayPattern):
    """A column of beams that spins about z; one line per azimuth, beams from the lowest to the highest.

    Attributes:
        lowest: Elevation of the lowest beam, degrees.
        highest: Elevation of the highest beam, degrees.
        beams: Number of beams, evenly spaced.
        lines: Azimuths per turn.
    """

    lowest: float
    highest: float
    beams: int
    lines: int

    neighbour_axis: ClassVar[int] = 0

    @property
    def neighbour_angle(self) -> float:
        """Radians."""
        return float(2 * np.pi / self.lines)

    def directions(self) -> NDArray[np.float32]:
        """Unit vectors (lines, rays, 3)."""
        elevation = np.radians(np.linspace(self.lowest, self.highest, self.beams))
        azimuth = (2 * np.pi / self.lines * np.arange(self.lines))[:, None]
        level = np.cos(elevation)
        return unit_vectors(level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation))

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each point lies between the lowest and the highest beam."""
        elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
        low, high = np.radians(self.lowest) - BORDER, np.radians(self.highest) + BORDER
        return (low <= elevation) & (elevation <= high)

    def thinned(self, density: float) -> SpinningBeams:
        """More or fewer azimuths: the number of beams is fixed."""
        return replace(self, lines=fewer(self.lines, density))
