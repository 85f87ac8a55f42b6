"""Novel points that touch: groups found on cells, so that a cluster costs its cells and not its points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gmmtorch import PointClouds
from novelty.preprocess import PreparedScans
from novelty.result import PointState
from novelty.segment import Segment, SegmentedPoints

REACH = 3.0
"""Cells touch when their centres are within this many typical cell extents."""


def novel_clusters(scans: PreparedScans, novel: torch.Tensor) -> torch.Tensor:
    """Group the novel points of B scans by contact.

    Args:
        scans: The scans.
        novel: bool (N,), over their examined points.

    Returns:
        int64 (N,): number of the group within its scan, from 0 in the order of first appearance; -1 where not novel.
    """
    reach = REACH * torch.maximum(scans.cell_size, scans.spacing)
    groups = torch.full_like(scans.cell_of_point, -1)
    split = scans.points.split
    packed = (scans.points.points, scans.cell_of_point, novel, groups)
    for points, cells, members, into, distance in zip(*map(split, packed), reach.tolist(), strict=True):
        if members.any():
            into[members] = torch.from_numpy(
                _groups(points[members].numpy(), cells[members].numpy(), distance)
            )
    return groups


def drop_specks(segmented: SegmentedPoints, scans: PreparedScans, settings: Segment) -> SegmentedPoints:
    """Call novel points unchanged that touch fewer than `settings.min_points` others."""
    if settings.min_points == 1:
        return segmented
    labels = segmented.labels
    groups = novel_clusters(scans, labels)
    states = segmented.states.clone()
    for group, state, members in zip(*map(scans.points.split, (groups, states, labels)), strict=True):
        if members.any():
            sizes = torch.bincount(group[members])
            specks = members & (sizes[group.clamp_min(0)] < settings.min_points)
            state[specks] = int(PointState.UNCHANGED)
    return replace(segmented, states=states)


def _groups(points: NDArray[np.float64], cells: NDArray[np.int64], reach: float) -> NDArray[np.int64]:
    _, cell = np.unique(cells, return_inverse=True)
    count = np.bincount(cell)
    centre = points.mean(axis=0)
    sums = np.stack([np.bincount(cell, axis) for axis in (points - centre).T], axis=1)
    touching = cKDTree(sums / count[:, None]).query_pairs(reach, output_type="ndarray")
    links = coo_array(
        (np.ones(len(touching)), (touching[:, 0], touching[:, 1])), shape=(len(count), len(count))
    )
    _, group_of_cell = connected_components(links, directed=False)
    return _in_order_of_appearance(group_of_cell[cell])


def _in_order_of_appearance(groups: NDArray[np.int32]) -> NDArray[np.int64]:
    _, first, inverse = np.unique(groups, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]
