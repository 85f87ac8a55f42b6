"""What a scan could see from one place: where its rays ended, in coarse cells.

Rays tell a hidden surface from a new one at the edges of what stands before it, so they are needed in full number. They
end on surfaces, which a few large cells follow; drawn from these, they are as many as they were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from gmmtorch import PointClouds
from novelty.maps.drawing import draw_points
from novelty.preprocess.simplify import Scale, simplify
from novelty.visibility import Rays, Sight, joint_sights

CELL_SIZE = 40
"""Rays that may end in one cell."""

MAX_VIEWS = 4
"""Places from which a map remembers what could be seen; the oldest are forgotten first."""

SAME_PLACE = 0.05
"""Two stations see the same when they are nearer than this share of the typical range."""

TOLERANCE = 3.0
"""An end has gone when rays pass it by more than this many resolutions."""


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


def renewed_views(views: Sequence[View], stations: Sequence[Rays], resolution: float) -> tuple[View, ...]:
    """The views after a new scan from `stations`, at most `MAX_VIEWS`, the latest last.

    Ends of old rays behind which the new scan saw are dropped: what they met has gone. A view is replaced by one from
    the same place.

    Args:
        views: The views so far.
        stations: Rays of the new scan, in the same frame.
        resolution: Length below which two scans of one surface cannot be told apart, m.
    """
    if not stations:
        return tuple(views)
    elsewhere = [view for view in views if not any(_same_place(view, rays) for rays in stations)]
    kept = [_without_gone(view, stations, resolution) for view in elsewhere]
    return (*kept, *(View.of(rays) for rays in stations))[-MAX_VIEWS:]


def _same_place(view: View, rays: Rays) -> bool:
    apart = float(np.linalg.norm(view.origin - rays.origin))
    return apart <= SAME_PLACE * float(np.median(rays.ranges)) if len(rays.ranges) else False


def _without_gone(view: View, stations: Sequence[Rays], resolution: float) -> View:
    ends = view.ends
    assert ends.spreads is not None
    sights = joint_sights(stations, ends.points.numpy(), TOLERANCE * resolution)
    stays = torch.from_numpy(sights != Sight.SEEN_THROUGH)
    kept = PointClouds(ends.points[stays], ends.weights[stays], ends.spreads[stays], (0, int(stays.sum())))
    return View(view.origin, kept)
