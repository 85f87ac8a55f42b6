"""What becomes of points called novel once it is known what the other scan could see."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from novelty.result import PointState
from novelty.section import section
from novelty.visibility.rays import Rays, Sight


@section
class Visibility:
    """Whether the other scan could have seen a change; needs the origins of the scans."""

    method: Literal["rays", "none"] = Field(
        default="rays",
        description="rays: a novel point counts when the other scan's rays went on behind it, is occluded when they "
        "ended before it, unobserved when none passed; none: every novel point counts.",
    )
    seen_share: float = Field(
        default=0.25,
        ge=0,
        le=1,
        description="Part of a group's judged points that must have been seen through for the whole group to count.",
    )
    tolerance: float = Field(
        default=3.0, gt=0, description="Range differences below this many times the resolution of the pair mean nothing."
    )


def judge(
    points: NDArray[np.float64],
    groups: NDArray[np.int64],
    other: Rays,
    resolution: float,
    settings: Visibility,
) -> NDArray[np.uint8]:
    """State of every point that a comparison called novel, uint8 (M,).

    A group of points (a component's connected novel points) that the other scan saw through is novel as a whole: its
    parts in shadow belong to the same thing. In other groups every point stands for itself.

    Args:
        points: (M, 3) novel points, m.
        groups: (M,) the group of each.
        other: The rays of the other scan, in the same frame.
        resolution: Range below which the two scans cannot be told apart, m.
        settings: How to judge.

    Returns:
        `PointState.NOVEL`, `OCCLUDED` or `UNOBSERVED`.
    """
    sights = other.sights(points, settings.tolerance * resolution)
    _, group = np.unique(groups, return_inverse=True)
    through = np.bincount(group, sights == Sight.SEEN_THROUGH)
    judged = through + np.bincount(group, sights == Sight.HIDDEN)
    seen = (through > 0) & (through >= settings.seen_share * judged)
    states = np.full(len(points), PointState.NOVEL, dtype=np.uint8)
    alone = ~seen[group]
    states[alone & (sights == Sight.HIDDEN)] = PointState.OCCLUDED
    states[alone & (sights == Sight.NO_RAY)] = PointState.UNOBSERVED
    return states
