"""Sparse outliers: points much farther from their neighbours than is usual.

What is usual in the whole scan (Rusu et al. 2008, the paper's choice) takes far and slanted surfaces for outliers, as
scans thin out with range: a small thing five metres away loses a fifth of its points. What is usual where the point
is (the idea of the local outlier factor, Breunig et al. 2000) leaves them alone and still finds the stray returns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from novelty.preprocess.settings import Preprocess
from novelty.preprocess.survivors import Survivors

STEP = "outlier"


def drop_outliers(scan: Survivors, settings: Preprocess) -> Survivors:
    """Take out points whose mean distance to their neighbours is unusual, see `Preprocess.outliers`."""
    if settings.outliers == "none" or len(scan) == 0:
        return scan
    if len(scan) <= settings.outlier_neighbors:
        return scan.noted(
            f"Outliers were left in: {len(scan)} points are too few to compare {settings.outlier_neighbors} "
            "neighbours."
        )
    if settings.outliers == "local":
        stays = _usual_there(scan.points, settings.outlier_neighbors, settings.outlier_ratio)
    else:
        stays = _usual_anywhere(scan.points, settings.outlier_neighbors, settings.outlier_std_ratio)
    return scan.only(stays, STEP)


def _usual_there(points: NDArray[np.float64], neighbors: int, ratio: float) -> NDArray[np.bool_]:
    """Whether each point (N, 3) is about as far from its neighbours as these are from theirs."""
    centred = points - points.mean(axis=0)
    tree = cKDTree(centred, compact_nodes=False, balanced_tree=False)
    distances, rows = tree.query(centred, k=neighbors + 1, workers=-1)  # the first is the point itself
    apart = distances[:, 1:].mean(axis=1)
    usual = np.median(apart[rows[:, 1:]], axis=1)
    usual = np.where(usual > 0, usual, np.median(apart))  # the neighbours coincide
    return (apart <= ratio * usual) | (usual == 0)


def _usual_anywhere(points: NDArray[np.float64], neighbors: int, std_ratio: float) -> NDArray[np.bool_]:
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
