"""Novel points in contact become objects, with an oriented box and their neighbours (section 2.4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.result import ComponentRecord, ObjectRecord

ADJACENT = 0.001
"""Two objects are neighbours when a component of one shares at least this part with a component of the other."""


@dataclass(frozen=True, eq=False)
class OrientedBox:
    """A box: `center` (3,), `extent` (3,) longest edge first, `rotation` (3, 3) with the box's axes as columns."""

    center: NDArray[np.float64]
    extent: NDArray[np.float64]
    rotation: NDArray[np.float64]

    @classmethod
    def around(cls, points: NDArray[np.float64]) -> OrientedBox:
        """The box of points (N, 3), N >= 1, along their principal axes."""
        mean = points.mean(axis=0)
        _, axes = np.linalg.eigh((points - mean).T @ (points - mean))
        axes = axes[:, np.argsort(-np.ptp((points - mean) @ axes, axis=0), kind="stable")]
        if np.linalg.det(axes) < 0:
            axes[:, 2] = -axes[:, 2]
        along = (points - mean) @ axes  # (N, 3)
        middle = (along.min(axis=0) + along.max(axis=0)) / 2
        return cls(center=mean + axes @ middle, extent=np.ptp(along, axis=0), rotation=axes)


def group_objects(
    points: NDArray[np.float64],
    point_components: NDArray[np.int64],
    point_scores: NDArray[np.float64],
    groups: NDArray[np.int64],
    components: Sequence[ComponentRecord],
    overlaps: NDArray[np.float64],
    kind: str,
) -> tuple[ObjectRecord, ...]:
    """Turn the groups of novel points of one scan into objects, largest first.

    Args:
        points: (N, 3) points of the scan as given.
        point_components: (N,) component of every point, -1 without one.
        point_scores: (N,) score of every point, NaN where not examined.
        groups: (N,) number of the group of novel points in contact, -1 where not novel; see `novel_clusters`.
        components: Every component of the scan's mixture.
        overlaps: (K, K) shared responsibilities, see `SegmentedPoints.overlaps`.
        kind: `added` or `removed`.
    """
    novel = np.flatnonzero(groups >= 0)
    if not len(novel):
        return ()
    sizes = np.bincount(groups[novel])
    members = [novel[groups[novel] == group] for group in np.argsort(-sizes, kind="stable") if sizes[group]]
    owners = [_components_of(point_components[member]) for member in members]
    return tuple(
        _record(
            index,
            points[member],
            float(np.median(point_scores[member])),
            owners[index],
            components,
            _neighbours(index, owners, overlaps),
            kind,
        )
        for index, member in enumerate(members)
    )


def _components_of(point_components: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.unique(point_components[point_components >= 0])


def _neighbours(
    index: int, owners: list[NDArray[np.int64]], overlaps: NDArray[np.float64]
) -> tuple[int, ...]:
    own = owners[index]
    return tuple(
        other
        for other, group in enumerate(owners)
        if other != index and overlaps[np.ix_(own, group)].max(initial=0.0) >= ADJACENT
    )


def _record(
    index: int,
    points: NDArray[np.float64],
    score: float,
    group: NDArray[np.int64],
    components: Sequence[ComponentRecord],
    neighbours: tuple[int, ...],
    kind: str,
) -> ObjectRecord:
    box = OrientedBox.around(points)
    own = [record for record in components if record.index in group]
    p_values = [record.p_value for record in own if not np.isnan(record.p_value)]
    return ObjectRecord(
        index=index,
        kind=kind,
        components=tuple(int(k) for k in group),
        neighbours=neighbours,
        num_points=len(points),
        centroid=points.mean(axis=0),
        extent=box.extent,
        rotation=box.rotation,
        center=box.center,
        score=max((record.score for record in own), default=float("nan")),
        p_value=min(1.0, len(p_values) * min(p_values)) if p_values else float("nan"),
    )
