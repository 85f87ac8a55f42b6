"""What becomes of points called novel once it is known what the other scan could see."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field

from novelty.clusters import novel_clusters
from novelty.preprocess import PreparedScans
from novelty.result import PointState
from novelty.section import section
from novelty.segment import SegmentedPoints
from novelty.visibility.patches import patch_normals
from novelty.visibility.rays import Sight, has_stations, joint_sights

LEAST_SEEN = 0.2
"""A group must have been seen through in at least this share of all its points to be novel as a whole."""

LEAST_CLEAR = 0.2
"""Share of the points of a cluster past which rays went that must have been seen through clearly, not beside edges."""

STATE_OF_SIGHT = {
    Sight.NO_RAY: PointState.UNOBSERVED,
    Sight.SEEN_THROUGH: PointState.NOVEL,
    Sight.HIDDEN: PointState.OCCLUDED,
    Sight.SURFACE: PointState.UNCHANGED,
    Sight.BESIDE: PointState.NOVEL,
}
"""What a novel point becomes that stands for itself."""


@section
class Visibility:
    """Whether the other scan could have seen a change; needs the origins of the scans."""

    method: Literal["rays", "none"] = Field(
        default="rays",
        description="rays: a novel point counts when the other scan's rays went on behind it, is occluded when they "
        "ended before it, unobserved when none passed; none: every novel point counts.",
    )
    seen_share: float = Field(
        default=0.5,
        ge=0,
        le=1,
        description="Part of a group's judged points that must have been seen through for the whole group to count.",
    )
    tolerance: float = Field(
        default=3.0,
        gt=0,
        description="Range differences below this many times the resolution of the pair mean nothing.",
    )


def judge(
    segmented: SegmentedPoints,
    scans: PreparedScans,
    others: PreparedScans,
    resolution: torch.Tensor,
    settings: Visibility,
) -> SegmentedPoints:
    """Turn novel points that the other scan could not have seen into occluded or unobserved ones.

    Args:
        segmented: Labels of the B scans.
        scans: The B scans labelled.
        others: The B scans they were compared with, in the same frame. Where it is not known from which places one
            was taken, or its sensor moved, the labels stay as they are.
        resolution: (B,) m, range below which two scans of one surface cannot be told apart.
        settings: How to judge.
    """
    labels = segmented.labels
    clusters = novel_clusters(scans, labels)
    groups = clusters * segmented.counts.shape[1] + segmented.components
    states = segmented.states.clone()
    asked = torch.zeros(len(scans.cells.points), dtype=torch.bool)
    asked[scans.cell_of_point[labels]] = True
    parts = zip(
        scans.points.split(scans.points.points),
        scans.points.split(labels),
        scans.points.split(clusters),
        scans.points.split(groups),
        scans.points.split(states),
        scans.points.split(patch_normals(scans, asked)[scans.cell_of_point]),
        others.stations,
        resolution.tolist(),
        strict=True,
    )
    for points, novel, cluster, group, state, normals, stations, length in parts:
        if not stations or not novel.any():
            continue
        sights = joint_sights(
            stations, points[novel].numpy(), settings.tolerance * length, normals[novel].numpy()
        )
        verdict = _verdict(sights, cluster[novel].numpy(), group[novel].numpy(), settings)
        state[novel] = torch.from_numpy(verdict)
    return replace(segmented, states=states)


def blind_notes(reference: PreparedScans, current: PreparedScans) -> list[tuple[str, ...]]:
    """For each pair, what cannot be told for want of an origin, and what to do about it."""
    notes: list[tuple[str, ...]] = []
    for row in range(len(reference)):
        roles = [
            role
            for role, scans in (("reference", reference), ("current", current))
            if not has_stations(scans.origins[row])
        ]
        if not roles:
            notes.append(())
            continue
        whose = f"the {roles[0]} scan has" if len(roles) == 1 else "both scans have"
        notes.append(
            (
                f"visibility: {whose} no single sensor origin, so what was never seen may be called "
                f"novel; give the sensor's position to tell hidden from new.",
            )
        )
    return notes


def _verdict(
    sights: NDArray[np.uint8],
    clusters: NDArray[np.int64],
    groups: NDArray[np.int64],
    settings: Visibility,
) -> NDArray[np.uint8]:
    """State of every novel point (M,).

    A group of points (the connected novel points of one component) that the other scan mostly saw through is novel as
    a whole: its parts in shadow belong to the same thing. In other groups every point stands for itself, and one that
    lies on a surface the other scan measured is unchanged after all. What was only seen beside the edges of nearer
    things, and hardly anywhere clearly, lies in their shadow.
    """
    _, group = np.unique(groups, return_inverse=True)
    size = np.bincount(group)
    through = np.bincount(group, (sights == Sight.SEEN_THROUGH) | (sights == Sight.BESIDE))
    judged = size - np.bincount(group, sights == Sight.NO_RAY)
    seen = (through >= settings.seen_share * judged) & (through >= LEAST_SEEN * size)
    states = np.choose(sights, [STATE_OF_SIGHT[sight] for sight in Sight]).astype(np.uint8)
    states[seen[group]] = PointState.NOVEL
    clear = np.bincount(clusters, sights == Sight.SEEN_THROUGH)
    beside = np.bincount(clusters, sights == Sight.BESIDE)
    in_shadow = clear < LEAST_CLEAR * (clear + beside)
    states[(states == PointState.NOVEL) & in_shadow[clusters]] = PointState.UNOBSERVED
    return states
