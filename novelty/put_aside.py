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
    """Which points (N,) are in a group most of which has one of the returns (M, 3) nearby."""
    known = np.zeros(len(points), dtype=bool)
    novel = np.flatnonzero(groups >= 0)
    if not len(novel) or not len(returns):
        return known
    members = np.split(
        novel[np.argsort(groups[novel], kind="stable")], np.bincount(groups[novel]).cumsum()[:-1]
    )
    reaches = [_reach(points[group], resolution) for group in members]
    tree = cKDTree(_around(points[novel], returns, max(reaches)), compact_nodes=False, balanced_tree=False)
    for group, reach in zip(members, reaches, strict=True):
        distances = tree.query(points[group], distance_upper_bound=reach, workers=-1)[0]
        known[group] = np.isfinite(distances).mean() > MEASURED
    return known


def _reach(group: Array, resolution: float) -> float:
    """How near a return is as near as the points of a group (n, 3) are to each other, m; 0 for a single point."""
    if len(group) < 2:
        return 0.0
    apart = cKDTree(group).query(group, k=[2], workers=-1)[0]
    return max(AS_NEAR * float(np.median(apart)), resolution)


def _around(points: Array, returns: Array, reach: float) -> Array:
    """Returns (M, 3) in the box around the points, widened by the reach."""
    inside = np.ones(len(returns), dtype=bool)
    for low, high, column in zip(
        points.min(axis=0) - reach, points.max(axis=0) + reach, returns.T, strict=True
    ):
        inside &= (column >= low) & (column <= high)
    return returns[inside]
