"""A range sensor: where its rays go, how it reads a distance, which returns it loses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from novelty.simulation.sensors.pattern import RayPattern
from novelty.simulation.sensors.ranging import LaserRanging, Ranging


@dataclass(frozen=True)
class Sensor:
    """A range sensor.

    Attributes:
        name: What results call it.
        pattern: Its rays.
        ranging: Its noise and quantisation.
        min_range: Nearest return, m.
        max_range: Farthest return, m.
        dropout: Share of rays that are lost at random.
        mixed_pixels: Share of the rays next to a depth edge that return a distance between both sides.
        max_incidence: Angle between ray and surface normal beyond which nothing returns, degrees.
        emitter: Where the light leaves, (3,) in the sensor's frame, m; surfaces it cannot reach return nothing.
            None when it leaves where it is received.
    """

    name: str
    pattern: RayPattern
    ranging: Ranging
    min_range: float
    max_range: float
    dropout: float = 0.0
    mixed_pixels: float = 0.0
    max_incidence: float = 87.0
    emitter: tuple[float, float, float] | None = None

    @property
    def min_cosine(self) -> float:
        """Cosine of `max_incidence`."""
        return math.cos(math.radians(self.max_incidence))

    def with_noise(self, std: float) -> Sensor:
        """This sensor with constant Gaussian range noise of standard deviation `std`, m."""
        return replace(self, ranging=self.ranging.with_noise(std))

    def with_density(self, density: float) -> Sensor:
        """This sensor with about `density` times as many rays in the same field of view."""
        return replace(self, pattern=self.pattern.thinned(density))

    def ideal(self) -> Sensor:
        """This sensor without noise, dropouts and mixed pixels."""
        exact = LaserRanging(0.0, quantum=0.0)
        return replace(self, ranging=exact, dropout=0.0, mixed_pixels=0.0)
