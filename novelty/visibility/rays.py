"""The rays of a scan around its origin: what the sensor saw in a direction, and how far it saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

NEIGHBOURS = 6
"""Rays of the other scan that are asked about one point."""

REACH = 1.0
"""A ray speaks for a point when it passes within this many typical gaps between neighbouring rays."""

THROUGH = 1 / 3
"""Share of that gap within which it passes through the point itself: on a line of rays, one step to either side."""

ONE_SIDED = 0.6
"""Mean offset of rays as a share of their mean distance above which they pass at one side: 0.64 of half a disc."""

STEEPEST = 5.0
"""Greatest slope of a surface against a ray that is reckoned with, some 79 degrees."""

MOST_UNEVEN = 3.0
"""How many times as far apart the lines of a pattern may be as the sixth neighbour on them before lines are thinned."""

FINEST = 1e-4
"""Chord below which rays are one ray, rad: of a sensor that stood still each is repeated."""

WIDEST = 0.2
"""Lines farther apart are no pattern that looks at a place, rad."""

FILLED = 2.0**1.5
"""Boxes of a size to those of double the size above which directions fill a surface: 2 on a line, 4 on a surface."""

MAX_STATIONS = 16
"""A scan taken from more places than these is one of a moving sensor, whose single rays are too few to ask."""


class Sight(IntEnum):
    """What another scan knows of a point in space."""

    NO_RAY = 0
    SEEN_THROUGH = 1
    HIDDEN = 2
    SURFACE = 3
    BESIDE = 4


STRONGEST = (Sight.SEEN_THROUGH, Sight.SURFACE, Sight.BESIDE, Sight.HIDDEN)
"""Of several stations' sights of one point the first that occurs counts: what was free once is new when filled."""


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Rays that are asked together.

    Attributes:
        rows: (n,) their numbers in the scan.
        tree: of their directions.
        gap: typical chord on the unit sphere from one to the `NEIGHBOURS`-th one beside it.
    """

    rows: NDArray[np.intp]
    tree: cKDTree
    gap: float

    @classmethod
    def of(cls, directions: NDArray[np.float64], rows: NDArray[np.intp]) -> _Pattern:
        """The rays at `rows` of directions (N, 3), one at least."""
        chosen = directions[rows]
        tree = cKDTree(chosen, balanced_tree=False, compact_nodes=False)
        sample = chosen[:: max(1, len(chosen) // 2000)]
        chords, _ = tree.query(sample, k=[min(NEIGHBOURS + 1, len(chosen))], workers=-1)
        return cls(rows, tree, max(float(np.median(chords)), FINEST))


@dataclass(frozen=True, eq=False)
class Rays:
    """The returns of one scan as seen from its origin.

    Attributes:
        origin: (3,) where the sensor stood, m.
        directions: (N, 3) unit vectors.
        ranges: (N,) m.
    """

    origin: NDArray[np.float64]
    directions: NDArray[np.float64]
    ranges: NDArray[np.float64]

    @classmethod
    def of(cls, points: NDArray[np.float64], origin: NDArray[np.float64]) -> Rays:
        """The rays that ended in `points` (N, 3); a point on the origin itself has no direction and is left out."""
        away = points - origin
        ranges = np.linalg.norm(away, axis=1)
        real = ranges > 0
        return cls(origin=origin, directions=away[real] / ranges[real, None], ranges=ranges[real])

    @cached_property
    def _patterns(self) -> tuple[_Pattern, ...]:
        """All rays; and as many of each line of the pattern as its lines are apart, where these are far apart.

        Where a spinning lidar stood still for some turns, every ray has more neighbours on its own line than are asked,
        and between the lines would be no ray at all.
        """
        rows = np.arange(len(self.directions))
        full = _Pattern.of(self.directions, rows)
        wide = _line_gap(self.directions, full.gap)
        if wide <= MOST_UNEVEN * full.gap:
            return (full,)
        boxes = np.floor((self.directions + 1.0) / (wide / MOST_UNEVEN)).astype(np.int64)
        return full, _Pattern.of(self.directions, rows[np.unique(_numbers(boxes), return_index=True)[1]])

    def sights(
        self,
        points: NDArray[np.float64],
        tolerance: float,
        normals: NDArray[np.float64] | None = None,
    ) -> NDArray[np.uint8]:
        """Say of every point (M, 3) whether this scan saw through it, a surface there, or something before it.

        A ray passes beside a point and not through it. If the point's surface is known, the ray says how far along
        itself that surface would have stopped it; without, rays that bracket the point may have met a slanted one.

        Args:
            points: Places in space, m.
            tolerance: Range difference that noise and pose error explain, m.
            normals: (M, 3) unit normals of the surfaces that the points are on, zero where a single line was all of it
                that was seen, NaN where nothing is known; None: nothing of any.

        Returns:
            `Sight` of each point, uint8 (M,). SEEN_THROUGH when every neighbouring ray went on behind the point,
            HIDDEN when every one ended before it, SURFACE when one ended on it, NO_RAY when none passes near. When
            some went on and others ended before, at the edge of something nearer: BESIDE or HIDDEN, whichever most
            say; SURFACE where the normal is unknown. Past a surface so steep that the error of its normal decides rays
            go BESIDE at best, and so they do past a line unless they pass through it. Where the rays are lines far
            apart, one that passes through a point is enough; past the point it has to be so on both sides. Nor do rays
            that all pass at one side clear a point, as at the rim of a hole where nothing returned.
        """
        if not len(self.ranges):
            return np.full(len(points), Sight.NO_RAY, dtype=np.uint8)
        first, *thinned = self._patterns
        sights, through, around = self._sights_in(first, points, tolerance, normals)
        for pattern in thinned:
            again = (sights == Sight.NO_RAY) | ((sights == Sight.SEEN_THROUGH) & ~through)
            facing = None if normals is None else normals[again]
            wider, _, around[again] = self._sights_in(pattern, points[again], tolerance, facing)
            past_one_side = (sights[again] == Sight.SEEN_THROUGH) & (wider != Sight.SEEN_THROUGH)
            sights[again] = np.where(past_one_side, Sight.BESIDE, wider)
        sights[(sights == Sight.SEEN_THROUGH) & ~(through | around)] = Sight.BESIDE
        return sights

    def _sights_in(
        self,
        pattern: _Pattern,
        points: NDArray[np.float64],
        tolerance: float,
        normals: NDArray[np.float64] | None,
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_], NDArray[np.bool_]]:
        """`Sight` of each point by the rays of one pattern, whether one passes through it, and whether all round it."""
        sights = np.full(len(points), Sight.NO_RAY, dtype=np.uint8)
        away = points - self.origin
        ranges = np.linalg.norm(away, axis=1)
        directions = away / np.maximum(ranges, np.finfo(float).tiny)[:, None]
        chords, rows = pattern.tree.query(
            directions, k=NEIGHBOURS, distance_upper_bound=REACH * pattern.gap, workers=-1
        )
        near = np.isfinite(chords)  # (M, NEIGHBOURS)
        slopes = _slopes(directions, normals)
        line = np.isinf(slopes)
        leaning = np.minimum(np.nan_to_num(slopes), STEEPEST)
        slack = tolerance + np.where(near, chords, 0.0) * (ranges * leaning)[:, None]
        rows = pattern.rows[np.where(near, rows, 0)]
        beyond = self.ranges[rows] - ranges[:, None]
        total = near.sum(axis=1)
        behind = (near & (beyond > slack)).sum(axis=1)
        before = (near & (beyond < -slack)).sum(axis=1)
        torn = (behind + before == total) & ~(np.isnan(slopes) | line)  # nothing ended on the point's surface
        steep = (slopes > STEEPEST) & ~line
        through = chords[:, 0] < THROUGH * pattern.gap
        seen = total > 0
        sights[seen & ~torn] = Sight.SURFACE
        sights[seen & torn & ~steep] = Sight.HIDDEN
        sights[seen & torn & ~steep & (behind >= before)] = Sight.BESIDE
        sights[seen & (before == total)] = Sight.HIDDEN
        sights[seen & (behind == total)] = Sight.SEEN_THROUGH
        sights[seen & (behind == total) & (steep | (line & ~through))] = Sight.BESIDE
        offsets = np.where(near[..., None], self.directions[rows] - directions[:, None], 0.0)
        aside = np.linalg.norm(offsets.sum(axis=1), axis=1)  # of the centre of the rays
        around = aside < ONE_SIDED * np.where(near, chords, 0.0).sum(axis=1)
        return sights, through, around


def _line_gap(directions: NDArray[np.float64], near: float) -> float:
    """Chord from which on directions (N, 3) fill a surface, and no lines or single points; `near` if none is found.

    The number of boxes they occupy falls with the square of the boxes' size there, on lines with the size itself (the
    box-counting dimension).
    """
    size, boxes = near, _occupied(np.floor((directions + 1.0) / near).astype(np.int64))
    while size < WIDEST:
        wider = _occupied(boxes // 2)
        if len(boxes) > FILLED * len(wider):
            return size
        size, boxes = 2 * size, wider
    return near


def _occupied(boxes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Boxes of a grid (n, 3), each once."""
    return boxes[np.unique(_numbers(boxes), return_index=True)[1]]


def _numbers(boxes: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number for each box of a grid (n, 3)."""
    x, y, z = boxes.T
    side = int(boxes.max(initial=0)) + 1
    return (x * side + y) * side + z


def _slopes(directions: NDArray[np.float64], normals: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Tangent of the angle between each direction (M, 3) and the normal of the surface it meets.

    Infinite for a normal of zero, of a line, which may be of any surface; NaN where it is unknown.
    """
    if normals is None:
        return np.full(len(directions), np.nan)
    cosines = np.abs(np.einsum("md,md->m", directions, normals))
    slopes = np.sqrt(np.maximum(1 - cosines**2, 0)) / np.maximum(cosines, 1e-9)
    return np.where((normals == 0).all(axis=1), np.inf, slopes)


def stations_of(returns: NDArray[np.float64], origins: NDArray[np.float64] | None) -> tuple[Rays, ...]:
    """The rays of a scan from each place where its sensor stood; none where that is not known, or it moved.

    Args:
        returns: (N, 3) what the rays met, m.
        origins: (3,), or (N, 3) for each return; None when unknown.
    """
    if not has_stations(origins):
        return ()
    assert origins is not None
    if origins.ndim == 1:
        return (Rays.of(returns, origins),)
    places, station = np.unique(origins, axis=0, return_inverse=True)
    return tuple(Rays.of(returns[station == row], place) for row, place in enumerate(places))


def has_stations(origins: NDArray[np.float64] | None) -> bool:
    """Whether a scan was taken from one place or a few known ones; origins as in `stations_of`."""
    if origins is None or origins.ndim == 1:
        return origins is not None
    sample = origins[:: max(1, len(origins) // 1000)]
    return all(len(np.unique(some, axis=0)) <= MAX_STATIONS for some in (sample, origins))


def joint_sights(
    stations: Sequence[Rays],
    points: NDArray[np.float64],
    tolerance: float,
    normals: NDArray[np.float64] | None = None,
) -> NDArray[np.uint8]:
    """What all stations together know of every point (M, 3), see `Rays.sights`; `Sight`, uint8 (M,)."""
    seen = np.stack([rays.sights(points, tolerance, normals) for rays in stations])  # (stations, M)
    joint = np.full(len(points), Sight.NO_RAY, dtype=np.uint8)
    for sight in reversed(STRONGEST):
        joint[(seen == sight).any(axis=0)] = sight
    return joint
