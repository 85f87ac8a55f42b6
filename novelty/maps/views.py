"""What a scan could see from one place: where its rays ended, in coarse cells.

Rays tell a hidden surface from a new one at the edges of what stands before it, so they are needed in full number. They
end on surfaces, which a few large cells follow; drawn from these, they are as many as they were.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from gmmtorch import PointClouds
from novelty.maps.drawing import draw_points
from novelty.preprocess.simplify import Scale, simplify
from novelty.visibility import Rays

CELL_SIZE = 40
"""Rays that may end in one cell."""

MAX_VIEWS = 4
"""Places from which a map remembers what could be seen; the oldest are forgotten first."""


@dataclass(frozen=True, eq=False)
class View:
    """The rays of one station.

    Attributes:
        origin: (3,) where the sensor stood, m.
        ends: One cloud of cells: where the rays ended.
    """

    origin: NDArray[np.float64]
    ends: PointClouds

    @classmethod
    def of(cls, rays: Rays) -> View:
        """The view that the rays of a station make."""
        returns = rays.origin + rays.directions * rays.ranges[:, None]
        cells = simplify(PointClouds.from_list([torch.from_numpy(returns)]), Scale(max_size=CELL_SIZE)).cells
        return cls(rays.origin, cells)

    def returns(self) -> NDArray[np.float64]:
        """Where the rays ended, (N, 3) m, drawn from the cells."""
        drawn: NDArray[np.float64] = draw_points(self.ends)[0].points.numpy()
        return drawn
