"""Novel points in contact become objects, with an oriented box and their neighbours (section 2.4.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from novelty.objects.box import OrientedBox
from novelty.result import ComponentRecord, ObjectRecord

ADJACENT = 0.001
"""Two objects are neighbours when a component of one shares at least this part with a component of the other."""


def number_objects(groups: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number the groups of novel points (N,) by their size, the largest is object 0; -1 stays -1."""
    novel = groups >= 0
    if not novel.any():
        return np.full_like(groups, -1)
    order = np.argsort(-np.bincount(groups[novel]), kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return np.where(novel, rank[groups], -1)


def describe_objects(
    points: NDArray[np.float64],
    point_objects: NDArray[np.int64],
    point_components: NDArray[np.int64],
    point_scores: NDArray[np.float64],
    point_p_values: NDArray[np.float64],
    components: Sequence[ComponentRecord],
    overlaps: NDArray[np.float64],
    kind: str,
) -> tuple[ObjectRecord, ...]:
    """Say of every object of one scan what it is, in the order of their numbers.

    Args:
        points: (N, 3) points of the scan as given.
        point_objects: (N,) object of every point, -1 where it is not novel; see `number_objects`.
        point_components: (N,) component of every point, -1 without one.
        point_scores: (N,) score of every point, NaN where not examined.
        point_p_values: (N,) p-value of every point, NaN where there is none.
        components: Every component of the scan's mixture.
        overlaps: (K, K) shared responsibilities, see `SegmentedPoints.overlaps`.
        kind: `added` or `removed`.
    """
    members = [np.flatnonzero(point_objects == index) for index in range(point_objects.max(initial=-1) + 1)]
    owners = [_components_of(point_components[member]) for member in members]
    return tuple(
        _record(
            index,
            points[member],
            float(np.median(point_scores[member])),
            float(np.median(point_p_values[member])),
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
    median_p_value: float,
    group: NDArray[np.int64],
    components: Sequence[ComponentRecord],
    neighbours: tuple[int, ...],
    kind: str,
) -> ObjectRecord:
    box = OrientedBox.around(points)
    own = [record for record in components if record.index in group]
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
        score=max((record.score for record in own), default=score),
        p_value=float(np.minimum(1.0, 2 * median_p_value)),
    )
