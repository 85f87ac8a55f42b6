"""How a pair of scans is put into a 3D view: where it is cut, which way is up, from where it is seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

AXES = ("x", "y", "z")

FAR_FROM_ZERO = 100.0
"""Coordinates beyond this many scene sizes are shown from a shifted zero: browsers draw in float32."""

CEILING = 0.1
"""A ceiling is the top tenth of the height when it holds more than a tenth of the points."""


@dataclass(frozen=True, eq=False)
class Frame:
    """The box that both scans of a pair are shown in, in the unit of the scans.

    Attributes:
        shift: (3,) subtracted from every coordinate shown; whole numbers, 0 near the origin.
        low: (3,) lower corner of the box, shifted.
        high: (3,) upper corner of the box, shifted.
        depth_camera: Whether the axes are those of a depth camera: z ahead, y down. Otherwise z is up.
        top: Height (shifted; along z, or along -y) above which points are hidden at first.
    """

    shift: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    depth_camera: bool
    top: float

    @classmethod
    def around(cls, clouds: Sequence[NDArray[np.float64]]) -> Frame:
        """The box around all finite points (N, 3), a few far outliers left out."""
        points = np.concatenate(clouds)
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            points = np.zeros((1, 3))
        low, high = np.percentile(points, (0.2, 99.8), axis=0)
        margin = 0.03 * max(float((high - low).max()), 1e-6)
        low, high = low - margin, high + margin
        far = np.abs(low + high) / 2 > FAR_FROM_ZERO * (high - low).max()
        shift = np.where(far, np.round((low + high) / 2), 0.0)
        depth_camera = _looks_ahead(points)
        heights = (-points[:, 1] + shift[1]) if depth_camera else (points[:, 2] - shift[2])
        box_top = -low[1] + shift[1] if depth_camera else high[2] - shift[2]
        return cls(
            shift, low - shift, high - shift, depth_camera, min(_below_ceiling(heights), float(box_top))
        )

    @property
    def up_axis(self) -> int:
        """The axis along which heights are measured."""
        return 1 if self.depth_camera else 2

    def heights(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height of shown points (N, 3)."""
        return -points[:, 1] if self.depth_camera else points[:, 2]

    def below_ceiling(self) -> Frame:
        """The part of the box under `top`, into which one can see."""
        low, high = self.low.copy(), self.high.copy()
        if self.depth_camera:
            low[1] = -self.top
        else:
            high[2] = self.top
        return replace(self, low=low, high=high)

    def layout(self, unit: str) -> dict[str, Any]:
        """The `scene` of a plotly layout: equal scales on all axes, seen from a useful place."""
        size = self.high - self.low
        ratio = size / float(np.prod(size)) ** (1 / 3)
        scene: dict[str, Any] = {
            f"{axis}axis": self._axis(number, axis, unit) for number, axis in enumerate(AXES)
        }
        scene["aspectmode"] = "manual"
        scene["aspectratio"] = dict(zip(AXES, ratio.tolist(), strict=True))
        scene["camera"] = self._camera(ratio)
        scene["dragmode"] = "orbit"
        return scene

    def _axis(self, number: int, axis: str, unit: str) -> dict[str, Any]:
        shift = self.shift[number]
        moved = f" {'−' if shift > 0 else '+'} {abs(shift):,.0f}".replace(",", " ") if shift else ""
        return {
            "title": {"text": f"{axis}{moved} [{unit}]", "font": {"size": 11}},
            "range": [float(self.low[number]), float(self.high[number])],
            "showbackground": False,
            "showspikes": False,
            "nticks": 6,
            "tickfont": {"size": 10},
        }

    def _camera(self, ratio: NDArray[np.float64]) -> dict[str, Any]:
        distance = 1.12 * float(np.linalg.norm(ratio))
        if self.depth_camera:
            eye, up = np.array([0.25, -0.35, -1.0]), (0.0, -1.0, 0.0)
        else:
            lengthwise = ratio[0] > ratio[1]
            eye, up = np.array([0.45, -0.8, 0.75] if lengthwise else [0.8, -0.45, 0.75]), (0.0, 0.0, 1.0)
        eye = distance * eye / np.linalg.norm(eye)
        return {"eye": dict(zip(AXES, eye.tolist(), strict=True)), "up": dict(zip(AXES, up, strict=True))}


def _looks_ahead(points: NDArray[np.float64]) -> bool:
    """Whether all points lie in a narrow cone around +z with its tip at zero, as a depth camera sees them."""
    ahead = points[:, 2]
    if (ahead <= 0).mean() > 0.001:
        return False
    sideways = np.abs(points[:, :2]).max(axis=1)
    return bool(np.percentile(sideways / np.maximum(ahead, 1e-12), 99) < 1.0 and ahead.min() > 0)


def _below_ceiling(heights: NDArray[np.float64]) -> float:
    """The height under the ceiling; infinite without one."""
    low, high = np.percentile(heights, (0.2, 99.8))
    below_ceiling = high - CEILING * (high - low)
    has_ceiling = (heights > below_ceiling).mean() > CEILING
    return float(below_ceiling) if has_ceiling else math.inf
