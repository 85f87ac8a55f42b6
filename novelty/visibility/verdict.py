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
from novelty.visibility.rays import Rays, Sight


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
        others: The B scans they were compared with, in the same frame. Where one has no single known origin the
            labels stay as they are.
        resolution: (B,) m, range below which two scans of one surface cannot be told apart.
        settings: How to judge.
    """
    labels = segmented.labels
    groups = novel_clusters(scans, labels) * segmented.counts.shape[1] + segmented.components
    states = segmented.states.clone()
    parts = zip(
        scans.points.split(scans.points.points),
        scans.points.split(labels),
        scans.points.split(groups),
        scans.points.split(states),
        others.returns,
        others.origins,
        resolution.tolist(),
        strict=True,
    )
    for points, novel, group, state, returns, origin, length in parts:
        if origin is None or origin.ndim != 1 or not novel.any():
            continue
        rays = Rays.of(returns, origin)
        verdict = _verdict(points[novel].numpy(), group[novel].numpy(), rays, length, settings)
        state[novel] = torch.from_numpy(verdict)
    return replace(segmented, states=states)


def blind_notes(reference: PreparedScans, current: PreparedScans) -> list[tuple[str, ...]]:
    """For each pair, what cannot be told for want of an origin, and what to do about it."""
    notes: list[tuple[str, ...]] = []
    for origins in zip(reference.origins, current.origins, strict=True):
        roles = [
            role
            for role, origin in zip(("reference", "current"), origins, strict=True)
            if origin is None or origin.ndim != 1
        ]
        if not roles:
            notes.append(())
            continue
        whose = " and ".join(roles)
        notes.append(
            (
                f"visibility: the {whose} scan has no single sensor origin, so what it could not see may be called "
                f"novel; give the sensor's position to tell hidden from new.",
            )
        )
    return notes


def _verdict(
    points: NDArray[np.float64],
    groups: NDArray[np.int64],
    other: Rays,
    resolution: float,
    settings: Visibility,
) -> NDArray[np.uint8]:
    """State of every novel point (M,).

    A group of points (the connected novel points of one component) that the other scan saw through is novel as a
    whole: its parts in shadow belong to the same thing. In other groups every point stands for itself.
    """
    sights = other.sights(points, settings.tolerance * resolution)
    _, group = np.unique(groups, return_inverse=True)
    through = np.bincount(group, sights == Sight.SEEN_THROUGH)
    judged = through + np.bincount(group, sights == Sight.HIDDEN)
    seen = (through > 0) & (through >= settings.seen_share * judged)
    states = np.full(len(points), PointState.NOVEL, dtype=np.uint8)
    alone = ~seen[group]
    states[alone & (sights == Sight.HIDDEN)] = PointState.OCCLUDED
    states[alone & (sights == Sight.NO_RAY)] = PointState.UNOBSERVED
    return states
