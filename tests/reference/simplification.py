"""Simplification written as the paper tells it: one cluster at a time, recursively (section 2.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def partition(
    points: NDArray[np.float64], rule: str, max_size: int, max_surface_variation: float
) -> list[NDArray[np.int64]]:
    """Indices of the points of every cell, each ascending, the cells by their smallest index."""
    centred = points - points.mean(axis=0) if len(points) else points
    leaves = _leaves(centred, np.arange(len(points)), rule, max_size, max_surface_variation)
    return sorted(leaves, key=lambda leaf: leaf[0])


def _leaves(
    points: NDArray[np.float64], members: NDArray[np.int64], rule: str, max_size: int, max_variation: float
) -> list[NDArray[np.int64]]:
    if len(members) == 0:
        return []
    offsets = points[members] - points[members].mean(axis=0)
    variances, axes = np.linalg.eigh(offsets.T @ offsets / len(members))
    large = len(members) > max_size
    curved = variances.sum() > 0 and variances[0] / variances.sum() > max(max_variation, 1e-7)
    split = (large or curved) if rule == "or" else (large and curved)
    if not split or variances[2] <= 0:
        return [members]
    axis = axes[:, 2] * np.sign(axes[np.abs(axes[:, 2]).argmax(), 2])
    above = offsets @ axis > 1e-9 * np.sqrt(variances[2])
    if above.all() or not above.any():
        return [members]
    return [
        leaf
        for half in (members[~above], members[above])
        for leaf in _leaves(points, half, rule, max_size, max_variation)
    ]
