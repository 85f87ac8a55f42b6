"""Points that preprocessing put aside: what the other scan measured there is not new, though it was not compared.

Statistical outlier removal and the ground draw a line somewhere, and of two scans of one surface at its edge one may
keep what the other puts aside. A group of novel points is unchanged when the other scan has returns of its own among
most of them, as near as the group's points are to each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from novelty.clusters import novel_clusters
from novelty.preprocess import PreparedScans
from novelty.result import PointState
from novelty.segment import SegmentedPoints

Array = NDArray[np.float64]

AS_NEAR = 2.0
"""A return is among a group's points when nearer than this many times their distance to their neighbours."""

MEASURED = 0.5
"""Share of a group's points among which the other scan has returns that makes the group unchanged."""


def drop_measured(
    segmented: SegmentedPoints, scans: PreparedScans, others: PreparedScans, resolution: torch.Tensor
) -> SegmentedPoints:
    """Call novel groups unchanged where the other scan has returns that preprocessing put aside.

    Args:
        segmented: Labels of the B scans.
        scans: The B scans labelled.
        others: The B scans they were compared with, in the same frame.
        resolution: (B,) m, length below which the two scans of a pair cannot be told apart.
    """
    labels = segmented.labels
    states = segmented.states.clone()
    split = scans.points.split
    packed = (scans.points.points, novel_clusters(scans, labels), states)
    for points, groups, state, returns, least in zip(
        *map(split, packed), others.returns, resolution.tolist(), strict=True
    ):
        if len(points):
            state[_measured(points.numpy(), groups.numpy(), returns, least)] = int(PointState.UNCHANGED)
    return replace(segmented, states=states)


def _measured(
    points: Array, groups: NDArray[np.int64], returns: Array, resolution: float
) -> NDArray[np.bool_]:
    """Which points (N,) are in a group among which there are returns."""
    known = [g for g in range(groups.max(initial=-1) + 1) if _among(points[groups == g], returns, resolution)]
    return np.isin(groups, known)


def _among(group: Array, returns: Array, resolution: float) -> bool:
    """Whether most of a group's points (n, 3) have a return (M, 3) nearby."""
    if len(group) < 2:
        return False
    apart = cKDTree(group).query(group, k=[2])[0]
    reach = max(AS_NEAR * float(np.median(apart)), resolution)
    low, high = group.min(axis=0) - reach, group.max(axis=0) + reach
    near = returns[((returns >= low) & (returns <= high)).all(axis=1)]
    if not len(near):
        return False
    distances = cKDTree(near).query(group, distance_upper_bound=reach)[0]
    return bool(np.isfinite(distances).mean() > MEASURED)
