"""Feet: points that lie within the ground's tolerance and yet stand on it.

One tolerance serves the whole plane, as wide as heights scatter below the sensor, where rays meet the ground head-on.
Farther away rays graze it and heights are far finer, so that the tolerance costs a small thing a seventh of its points,
often the ones that make it large enough to count. Where another scan of the place is at hand, the ground is known
better than by its plane: a point stands on it that is higher than what the other scan measured around it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import stdtrit

from novelty.preprocess.ground import Plane

Array = NDArray[np.float64]

AROUND = 20
"""Points of the other scan's ground by which the ground at a place is known."""
FALSE_ALARM = 1e-3
"""Share of the ground's points that stand out by chance."""
UNCHANGED = 0.95
"""Share of the ground's points by which is told how much more than noise two scans of it differ."""
NEXT = 6
"""Points next to one on a surface; a foot has company among them, as chance seldom strikes twice in one place."""
SMALLEST = 1e-6
"""Least scatter as a share of the ground's tolerance, far above rounding and far below any sensor's noise."""


def feet_of(points: Array, ground: Plane, others: Array, other_ground: Plane) -> NDArray[np.bool_]:
    """Which points of a scan the ground holds that stand on it, as another scan of the place shows, bool (N,).

    Args:
        points: (N, 3) m.
        ground: The ground of their scan.
        others: (M, 3) m, points of the other scan; its pose need not be exact, since heights are counted from its own
            ground.
        other_ground: The ground of the other scan.
    """
    held, around = ground.holds(points), others[other_ground.holds(others)]
    feet = np.zeros(len(points), dtype=bool)
    if held.any() and len(around) >= AROUND:
        feet[held] = _stand_out(points[held], ground, around, other_ground)
        feet[feet] = _accompanied(points, feet, feet | ~held)
    return feet


def _stand_out(points: Array, ground: Plane, others: Array, other_ground: Plane) -> NDArray[np.bool_]:
    """Which points (n, 3) are higher than those of the other ground (m, 3) around them foretell.

    Student's t of one more height, stretched where the grounds differ by more than noise.
    """
    tree = cKDTree(_laid_flat(others, other_ground), compact_nodes=False, balanced_tree=False)
    rows = tree.query(_laid_flat(points, ground), k=AROUND, workers=-1)[1]
    heights = other_ground.heights(others)[rows]  # (n, AROUND)
    scatter = np.maximum(heights.std(axis=1, ddof=1), SMALLEST * other_ground.tolerance)
    excess = (ground.heights(points) - heights.mean(axis=1)) / (scatter * np.sqrt(1 + 1 / AROUND))
    usual = stdtrit(AROUND - 1, (1 + UNCHANGED) / 2)
    stretch = max(float(np.quantile(np.abs(excess), UNCHANGED)) / usual, 1.0)
    higher: NDArray[np.bool_] = excess > stretch * stdtrit(AROUND - 1, 1 - FALSE_ALARM)
    return higher


def _laid_flat(points: Array, plane: Plane) -> Array:
    return points - plane.heights(points)[:, None] * plane.normal


def _accompanied(points: Array, asked: NDArray[np.bool_], standing: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the points asked about have one that stands among those next to them; masks (N,) of points (N, 3)."""
    tree = cKDTree(points, compact_nodes=False, balanced_tree=False)
    others = list(range(2, NEXT + 2))  # the nearest is the point itself
    next_to = tree.query(points[asked], k=others, workers=-1)[1]
    return np.any(np.append(standing, False)[next_to], axis=1)  # N stands for a neighbour that is missing
