"""Sparse outliers: points much farther from their neighbours than is usual in the scan (Rusu et al. 2008)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from novelty.preprocess.settings import Preprocess
from novelty.preprocess.survivors import Survivors

STEP = "outlier"


def drop_outliers(scan: Survivors, settings: Preprocess) -> Survivors:
    """Take out points whose mean distance to their neighbours is above mean + ratio * std over the scan."""
    if settings.outliers == "none" or len(scan) == 0:
        return scan
    if len(scan) <= settings.outlier_neighbors:
        return scan.noted(
            f"Outliers were left in: {len(scan)} points are too few to compare {settings.outlier_neighbors} "
            "neighbours."
        )
    stays = _usual(scan.points, settings.outlier_neighbors, settings.outlier_std_ratio)
    return scan.only(stays, STEP)


def _usual(points: NDArray[np.float64], neighbors: int, std_ratio: float) -> NDArray[np.bool_]:
    import open3d

    centred = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points - points.mean(axis=0)))
    _, rows = centred.remove_statistical_outlier(neighbors, std_ratio)
    stays = np.zeros(len(points), dtype=bool)
    stays[np.asarray(rows, dtype=np.int64)] = True
    if not stays.any():  # all mean distances are equal, and Open3D asks for less than their mean
        return ~stays
    return stays | _clumped(points, ~stays, neighbors)


def _clumped(points: NDArray[np.float64], removed: NDArray[np.bool_], neighbors: int) -> NDArray[np.bool_]:
    """Removed points that coincide with their neighbours: Open3D takes a mean distance of 0 for an outlier."""
    _, group, sizes = np.unique(points[removed], axis=0, return_inverse=True, return_counts=True)
    clumped = np.zeros(len(points), dtype=bool)
    clumped[removed] = (sizes >= neighbors)[group.reshape(-1)]
    return clumped
