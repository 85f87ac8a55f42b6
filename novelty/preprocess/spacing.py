"""How far apart the points of a scan are and how rough its surfaces, the lengths from which others are derived."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NUM_SAMPLES = 2000
NUM_NEIGHBORS = 16


@dataclass(frozen=True)
class Spacing:
    """Typical lengths of one scan, medians over its points, m; NaN where they are not defined.

    Attributes:
        distance: From a point to the nearest one that is elsewhere.
        noise: Standard deviation across the surface through a point's nearest neighbours.
    """

    distance: float = math.nan
    noise: float = math.nan


def spacing_of(points: NDArray[np.float64]) -> Spacing:
    """Spacing of points (N, 3), looked at from points evenly spaced in scan order."""
    from scipy.spatial import cKDTree

    if len(points) < 2:
        return Spacing()
    centred = points - points.mean(axis=0)
    tree = cKDTree(centred, compact_nodes=False, balanced_tree=False)
    samples = centred[np.linspace(0, len(points) - 1, min(NUM_SAMPLES, len(points)), dtype=np.int64)]
    distances, rows = tree.query(samples, min(NUM_NEIGHBORS, len(points)))  # (T, k)
    elsewhere = np.where(distances > 0, distances, np.inf).min(axis=1)
    if not np.isfinite(elsewhere).any():
        return Spacing()
    return Spacing(
        distance=float(np.median(elsewhere[np.isfinite(elsewhere)])),
        noise=float(np.sqrt(np.median(_least_variances(centred[rows])))),
    )


def _least_variances(groups: NDArray[np.float64]) -> NDArray[np.float64]:
    """Least eigenvalue of the covariance of each group: (T, k, 3) -> (T,)."""
    offsets = groups - groups.mean(axis=1, keepdims=True)
    covariances = offsets.transpose(0, 2, 1) @ offsets / groups.shape[1]
    return np.linalg.eigvalsh(covariances)[:, 0].clip(min=0)
