"""Where a sensor's rays go, in its own frame (x forward, y left, z up) and in the order of delivery."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

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


@dataclass(frozen=True)
class TiltingLaser(RayPattern):
    """A planar laser that sweeps about its z axis while a unit tilts it about y, one line per tilt angle.

    Attributes:
        field_of_view: Of the laser, degrees, symmetric about x.
        step: Between two rays of a line, degrees.
        tilt_from: First tilt, degrees, positive looks up.
        tilt_to: Last tilt, degrees.
        lines: Number of tilt angles.
    """

    field_of_view: float
    step: float
    tilt_from: float
    tilt_to: float
    lines: int

    @property
    def neighbour_angle(self) -> float:
        """Radians."""
        return float(np.radians(self.step))

    def directions(self) -> NDArray[np.float32]:
        """Unit vectors (lines, rays, 3)."""
        rays = round(self.field_of_view / self.step) + 1
        angle = np.radians(np.linspace(-self.field_of_view / 2, self.field_of_view / 2, rays))
        tilt = np.radians(np.linspace(self.tilt_from, self.tilt_to, self.lines))[:, None]
        x, y = np.cos(angle), np.sin(angle)
        return _stack(x * np.cos(tilt), y + 0 * tilt, x * np.sin(tilt))

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether a line passes each point: the tilt comes from x and z, the angle within the line from y."""
        x, y, z = points.T
        tilt, radius = np.arctan2(z, x), np.hypot(x, z)
        low = np.radians(min(self.tilt_from, self.tilt_to)) - BORDER
        high = np.radians(max(self.tilt_from, self.tilt_to)) + BORDER
        half = np.radians(self.field_of_view / 2) + BORDER
        front = (low <= tilt) & (tilt <= high) & (np.abs(np.arctan2(y, radius)) <= half)
        behind = np.arctan2(-z, -x)  # rays beyond 90 degrees leave backwards, tilted the other way
        back = (low <= behind) & (behind <= high) & (np.abs(np.arctan2(y, -radius)) <= half)
        return front | back

    def thinned(self, density: float) -> TiltingLaser:
        """More or fewer tilt angles: the laser's own step is fixed."""
        return _replace_lines(self, density)


@dataclass(frozen=True)
class RollingLaser(RayPattern):
    """A planar laser that a motor turns about its forward axis x, one line per roll angle; densest ahead.

    The "rolling scan" of Wulf & Wagner, Fast 3D scanning methods for laser measurement systems (CSCS 2003).

    Attributes:
        field_of_view: Of the laser, degrees, symmetric about x.
        step: Between two rays of a line, degrees.
        turn: Of the motor, degrees; half a turn covers everything in the field of view.
        lines: Number of roll angles.
    """

    field_of_view: float
    step: float
    turn: float
    lines: int

    @property
    def neighbour_angle(self) -> float:
        """Radians."""
        return float(np.radians(self.step))

    def directions(self) -> NDArray[np.float32]:
        """Unit vectors (lines, rays, 3)."""
        rays = round(self.field_of_view / self.step) + 1
        angle = np.radians(np.linspace(-self.field_of_view / 2, self.field_of_view / 2, rays))
        roll = np.radians(np.arange(self.lines) * self.turn / self.lines - self.turn / 2)[:, None]
        side = np.sin(angle)
        return _stack(np.cos(angle) + 0 * roll, side * np.cos(roll), side * np.sin(roll))

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether a line passes each point, with its left or its right half."""
        x, y, z = points.T
        ahead = np.arctan2(np.hypot(y, z), x) <= np.radians(self.field_of_view / 2) + BORDER
        roll = np.arctan(z / np.where(y == 0, 1e-12, y))  # a line through (y, z) also passes (-y, -z)
        return ahead & (np.abs(roll) <= np.radians(self.turn / 2) + BORDER)

    def thinned(self, density: float) -> RollingLaser:
        """More or fewer roll angles: the laser's own step is fixed."""
        return _replace_lines(self, density)


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
        return _stack(level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation) + 0 * azimuth)

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each point lies between the lowest and the highest beam."""
        elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
        low, high = np.radians(self.lowest) - BORDER, np.radians(self.highest) + BORDER
        return (low <= elevation) & (elevation <= high)

    def thinned(self, density: float) -> SpinningBeams:
        """More or fewer azimuths: the number of beams is fixed."""
        return _replace_lines(self, density)


@dataclass(frozen=True)
class PushBroom(RayPattern):
    """A planar laser that looks across the direction of travel x; the vehicle's motion is the other dimension.

    Attributes:
        field_of_view: Degrees, symmetric about straight up.
        step: Between two rays, degrees.
        spacing: Distance that the vehicle travels between two lines, m; a line stands for half of it on either side.
    """

    field_of_view: float
    step: float
    spacing: float

    @property
    def neighbour_angle(self) -> float:
        """Radians."""
        return float(np.radians(self.step))

    def directions(self) -> NDArray[np.float32]:
        """Unit vectors (1, rays, 3)."""
        rays = round(self.field_of_view / self.step) + 1
        angle = np.radians(np.linspace(-self.field_of_view / 2, self.field_of_view / 2, rays))[None]
        return _stack(0 * angle, np.sin(angle), np.cos(angle))

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each point lies in the slice that one line stands for."""
        x, y, z = points.T
        in_slice = np.abs(x) <= 0.51 * self.spacing
        return in_slice & (np.abs(np.arctan2(y, z)) <= np.radians(self.field_of_view / 2) + BORDER)

    def thinned(self, density: float) -> PushBroom:
        """More or fewer lines along the way: drive with `spacing` of the result."""
        return replace(self, spacing=self.spacing / density)


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
        return _stack(1 / norm, y / norm, z / norm)

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each point is in front of the camera and inside the image."""
        x, y, z = points.T
        wide = np.abs(y) * self.focal_length <= x * self.width / 2
        return (x > 0) & wide & (np.abs(z) * self.focal_length <= x * self.height / 2)

    def thinned(self, density: float) -> PinholeCamera:
        """More or fewer pixels in both directions, same angles."""
        factor = np.sqrt(density)
        return PinholeCamera(
            max(2, round(self.width * factor)),
            max(2, round(self.height * factor)),
            self.focal_length * factor,
        )


Lines = TypeVar("Lines", TiltingLaser, RollingLaser, SpinningBeams)


def _replace_lines(pattern: Lines, density: float) -> Lines:
    return replace(pattern, lines=max(2, round(pattern.lines * density)))


def _stack(x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float32]:
    result = np.empty((*x.shape, 3), dtype=np.float32)
    result[..., 0], result[..., 1], result[..., 2] = x, y, z
    return result
