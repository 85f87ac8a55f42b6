"""Novel points that touch: groups found on cells, so that a cluster costs its cells and not its points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from novelty.contact import contact_groups
from novelty.preprocess import PreparedScans
from novelty.result import PointState
from novelty.segment import Segment, SegmentedPoints


def novel_clusters(scans: PreparedScans, novel: torch.Tensor) -> torch.Tensor:
    """Group the novel points of B scans by contact.

    Contact is judged between cells and scales with their extents, so that a surface stays whole where the sensor's
    lines lie far apart.

    Args:
        scans: The scans.
        novel: bool (N,), over their examined points.

    Returns:
        int64 (N,): number of the group within its scan, from 0 in the order of first appearance; -1 where not novel.
    """
    least = torch.maximum(scans.cell_size, scans.spacing)
    groups = torch.full_like(scans.cell_of_point, -1)
    split = scans.points.split
    packed = (scans.points.points, scans.cell_of_point, novel, groups)
    for points, cells, members, into, extent in zip(*map(split, packed), least.tolist(), strict=True):
        if members.any():
            into[members] = torch.from_numpy(_groups(points[members].numpy(), cells[members].numpy(), extent))
    return groups


def drop_specks(
    segmented: SegmentedPoints,
    scans: PreparedScans,
    settings: Segment,
    chance_groups: torch.Tensor | None = None,
) -> SegmentedPoints:
    """Call novel points unchanged that touch too few others.

    Args:
        segmented: Labels of the B scans.
        scans: The B scans labelled.
        settings: `min_points` is the least group that counts.
        chance_groups: int64 (B,), size up to which groups are of chance; None: none are.
    """
    least = torch.full((len(scans),), settings.min_points)
    if chance_groups is not None:
        least = torch.maximum(least, chance_groups + 1)
    if (least == 1).all():
        return segmented
    labels = segmented.labels
    groups = novel_clusters(scans, labels)
    states = segmented.states.clone()
    packed = (groups, states, labels)
    for group, state, members, size in zip(*map(scans.points.split, packed), least.tolist(), strict=True):
        if members.any():
            specks = members & (torch.bincount(group[members])[group.clamp_min(0)] < size)
            state[specks] = int(PointState.UNCHANGED)
    return replace(segmented, states=states)


def _groups(points: NDArray[np.float64], cells: NDArray[np.int64], least_extent: float) -> NDArray[np.int64]:
    """Connected groups of points (M, 3) that lie in `cells` (M,), int64 (M,)."""
    _, cell, count = np.unique(cells, return_inverse=True, return_counts=True)
    offsets = points - points.mean(axis=0)
    centres = _sums(cell, offsets) / count[:, None]
    variances = _sums(cell, (offsets - centres[cell]) ** 2).sum(axis=1) / count
    extents = np.maximum(np.sqrt(variances), least_extent)  # (C,)
    return _in_order_of_appearance(contact_groups(centres, extents)[cell])


def _sums(cell: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of the rows of each cell, (M, 3) -> (C, 3)."""
    return np.stack([np.bincount(cell, column) for column in values.T], axis=1)


def _in_order_of_appearance(groups: NDArray[np.int32]) -> NDArray[np.int64]:
    _, first, inverse = np.unique(groups, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]
