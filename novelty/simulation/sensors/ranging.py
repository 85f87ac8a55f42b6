"""How a sensor turns a true distance into a reading: noise and quantisation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError

Ranges = NDArray[np.float32]


class Ranging(ABC):
    """The range error of a sensor."""

    @abstractmethod
    def read(self, ranges: Ranges, cosines: Ranges, rng: np.random.Generator) -> Ranges:
        """Readings (N,), m, of true `ranges` (N,), m, along rays at `cosines` (N,) to the optical axis."""

    @abstractmethod
    def with_noise(self, std: float) -> Ranging:
        """The same sensor with a range noise of constant standard deviation `std`, m."""


@dataclass(frozen=True)
class LaserRanging(Ranging):
    """Gaussian range noise of standard deviation sqrt(std^2 + (relative * range)^2), then rounding.

    Attributes:
        std: Constant part, m.
        relative: Part that grows with range, a share of it.
        quantum: Step of the readings, m; 0 for none.
    """

    std: float
    relative: float = 0.0
    quantum: float = 0.001

    def read(self, ranges: Ranges, cosines: Ranges, rng: np.random.Generator) -> Ranges:
        """Readings (N,), m."""
        noise = rng.standard_normal(ranges.shape, dtype=np.float32)
        if self.relative:
            noise *= np.hypot(np.float32(self.std), np.float32(self.relative) * ranges)
        else:
            noise *= np.float32(self.std)
        noise += ranges
        if self.quantum:
            np.rint(noise / np.float32(self.quantum), out=noise)
            noise *= np.float32(self.quantum)
        return noise

    def with_noise(self, std: float) -> LaserRanging:
        """The same rounding, constant noise."""
        return replace(self, std=std, relative=0.0)


@dataclass(frozen=True)
class DisparityRanging(Ranging):
    """Structured light: depth z from disparity d = f b / z, with Gaussian noise and rounding of d.

    Random error and step of the depth both grow with z^2, as derived by Khoshelham & Oude Elberink,
    Sensors 12 (2012) 1437.

    Attributes:
        focal_length: f, pixels.
        baseline: b, m.
        std: Standard deviation of the disparity, pixels.
        quantum: Step of the disparity, pixels.
    """

    focal_length: float
    baseline: float
    std: float
    quantum: float

    def read(self, ranges: Ranges, cosines: Ranges, rng: np.random.Generator) -> Ranges:
        """Readings (N,), m, along the rays."""
        disparity = np.float32(self.focal_length * self.baseline) / (ranges * cosines)
        disparity += np.float32(self.std) * rng.standard_normal(ranges.shape, dtype=np.float32)
        steps = np.maximum(np.rint(disparity / np.float32(self.quantum)), np.float32(1))
        return np.float32(self.focal_length * self.baseline / self.quantum) / (steps * cosines)

    def with_noise(self, std: float) -> DisparityRanging:
        """Not defined: the noise of a disparity is not constant in metres.

        Raises:
            InputError: Always.
        """
        raise InputError(
            f"A depth camera has no constant range noise (asked: {std} m); "
            "give it another DisparityRanging with dataclasses.replace."
        )
