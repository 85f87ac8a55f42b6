"""Planar lasers: a fan of rays, and the unit or the vehicle that moves it."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from novelty.simulation.sensors.pattern import BORDER, RayPattern, fewer, unit_vectors


@dataclass(frozen=True)
class PlanarLaser(RayPattern, ABC):
    """A laser whose rays lie in one plane.

    Attributes:
        field_of_view: Degrees, symmetric about the middle ray.
        step: Between two rays, degrees.
    """

    field_of_view: float
    step: float

    @property
    def neighbour_angle(self) -> float:
        """Radians."""
        return float(np.radians(self.step))

    @property
    def half_view(self) -> float:
        """Angle between the middle and the outermost ray, and a little more, radians."""
        return float(np.radians(self.field_of_view / 2) + BORDER)

    def fan(self) -> NDArray[np.float64]:
        """Angles (rays,) from the middle ray, radians."""
        rays = round(self.field_of_view / self.step) + 1
        return np.radians(np.linspace(-self.field_of_view / 2, self.field_of_view / 2, rays))


@dataclass(frozen=True)
class TiltingLaser(PlanarLaser):
    """A planar laser that sweeps about its z axis while a unit tilts it about y, one line per tilt angle.

    Attributes:
        tilt_from: First tilt, degrees, positive looks up.
        tilt_to: Last tilt, degrees.
        lines: Number of tilt angles.
    """

    tilt_from: float
    tilt_to: float
    lines: int

    def directions(self) -> NDArray[np.float32]:
        """Unit vectors (lines, rays, 3)."""
        angle = self.fan()
        tilt = np.radians(np.linspace(self.tilt_from, self.tilt_to, self.lines))[:, None]
        x, y = np.cos(angle), np.sin(angle)
        return unit_vectors(x * np.cos(tilt), y, x * np.sin(tilt))

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether a line passes each point: the tilt comes from x and z, the angle within the line from y."""
        x, y, z = points.T
        tilt, radius = np.arctan2(z, x), np.hypot(x, z)
        low = np.radians(min(self.tilt_from, self.tilt_to)) - BORDER
        high = np.radians(max(self.tilt_from, self.tilt_to)) + BORDER
        half = self.half_view
        front = (low <= tilt) & (tilt <= high) & (np.abs(np.arctan2(y, radius)) <= half)
        behind = np.arctan2(-z, -x)  # rays beyond 90 degrees leave backwards, tilted the other way
        back = (low <= behind) & (behind <= high) & (np.abs(np.arctan2(y, -radius)) <= half)
        return front | back

    def thinned(self, density: float) -> TiltingLaser:
        """More or fewer tilt angles: the laser's own step is fixed."""
        return replace(self, lines=fewer(self.lines, density))


@dataclass(frozen=True)
class RollingLaser(PlanarLaser):
    """A planar laser that a motor turns about its forward axis x, one line per roll angle; densest ahead.

    The "rolling scan" of Wulf & Wagner, Fast 3D scanning methods for laser measurement systems (CSCS 2003).

    Attributes:
        turn: Of the motor, degrees; half a turn covers everything in the field of view.
        lines: Number of roll angles.
    """

    turn: float
    lines: int

    def directions(self) -> NDArray[np.float32]:
        """Unit vectors (lines, rays, 3)."""
        angle = self.fan()
        roll = np.radians(np.arange(self.lines) * self.turn / self.lines - self.turn / 2)[:, None]
        side = np.sin(angle)
        return unit_vectors(np.cos(angle), side * np.cos(roll), side * np.sin(roll))

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether a line passes each point, with its left or its right half."""
        x, y, z = points.T
        ahead = np.arctan2(np.hypot(y, z), x) <= self.half_view
        roll = np.arctan(z / np.where(y == 0, 1e-12, y))  # a line through (y, z) also passes (-y, -z)
        return ahead & (np.abs(roll) <= np.radians(self.turn / 2) + BORDER)

    def thinned(self, density: float) -> RollingLaser:
        """More or fewer roll angles: the laser's own step is fixed."""
        return replace(self, lines=fewer(self.lines, density))


@dataclass(frozen=True)
class PushBroom(PlanarLaser):
    """A planar laser that looks across the direction of travel x; the vehicle's motion is the other dimension.

    Attributes:
        spacing: Distance that the vehicle travels between two lines, m; a line stands for half of it on either side.
    """

    spacing: float

    def directions(self) -> NDArray[np.float32]:
        """Unit vectors (1, rays, 3)."""
        angle = self.fan()[None]
        return unit_vectors(0 * angle, np.sin(angle), np.cos(angle))

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each point lies in the slice that one line stands for."""
        x, y, z = points.T
        in_slice = np.abs(x) <= 0.51 * self.spacing
        return in_slice & (np.abs(np.arctan2(y, z)) <= self.half_view)

    def thinned(self, density: float) -> PushBroom:
        """More or fewer lines along the way: drive with `spacing` of the result."""
        return replace(self, spacing=self.spacing / density)
