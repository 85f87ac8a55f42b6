"""Objects that are gone here and new there with the same shape: they were moved.

Two scans show two sides of a thing that was turned, so its two sets of points need not look alike. What can be asked
is that some rigid motion lays one over the other without a contradiction: what one scan shows of the thing must lie
on what the other shows of it, or be hidden there; nothing may lie where the other scan looked through. The agreement
of a motion is the share of the points, of the side better covered, that lie on the other side's surface, less twice
the share of either side in space that the other scan saw empty. Without the sensors' origins nobody knows what was
hidden, and every point without a partner counts against the motion, once. A wrong "moved" is worse than none: the
bar is high, and each object has one partner at most.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from novelty.objects.box import OrientedBox
from novelty.objects.rigid import Overlays, overlay
from novelty.visibility.rays import Rays, Sight, joint_sights

Array = NDArray[np.float64]

LEAST_AGREEMENT = 0.75
"""Agreement above which two objects are one that was moved."""

LEAST_SHARED = 1 / 3
"""Part of either view that must lie on the other: a small thing finds a place on any large one."""

AS_GOOD = 0.03
"""Motions whose agreement is this near the best are equally good: of these, the one that turns least is told."""

LEAST_SIZE_RATIO = 1 / 3
"""Least ratio of the longest edges of two boxes: one scan may show an end of a thing, or a stray with it."""

UNEQUAL = 0.1
"""Boxes are of one length when the ends of the longer one stand over by less than this part of it."""

LEAST_POINTS = 50
"""Fewer points have no shape."""

MOST_POINTS = 250
"""Points of an object that are laid over each other."""

DENSE_POINTS = 2000
"""Points of an object that others are measured against."""

COARSE_POINTS = 80
COARSE_STEPS, FINE_STEPS = 10, 12
LIKELY_STARTS, KEPT_STARTS = 16, 6
"""Motions whose agreement is looked at after the first look, which takes fewer points and steps; those refined."""

TOLERANCE = 1.5
"""Points lie on the other's surface when nearer than this many of its own gaps."""

FINEST, COARSEST = 2.0, 0.06
"""Bounds of that distance: this many resolutions of the pair, and this part of the object's longest edge."""

SEEN_THROUGH = 3.0
"""A place was empty when the other scan's rays went on for more than this many resolutions behind it."""

TURN_STEP = 15.0
"""Starts turn the object about the vertical in steps of this, degrees."""

MOST_CANDIDATES = 30
"""Pairs of objects that are looked at, those of most similar size first."""


@dataclass(frozen=True, eq=False)
class Move:
    """One object in both scans.

    Attributes:
        removed: Its index among the objects of the reference scan.
        added: Its index among the objects of the current scan.
        motion: (4, 4), from its place in the reference scan to its place in the current one, m, in the common frame.
        agreement: How well the two views of it fit under the best motion, 1 at best.
    """

    removed: int
    added: int
    motion: Array
    agreement: float


@dataclass(frozen=True, eq=False)
class Things:
    """The objects of one scan, in the common frame of the pair.

    Attributes:
        points: For each object its points, (n, 3) m.
        stations: What this scan saw from each place of its sensor; empty where these are not known.
    """

    points: tuple[Array, ...]
    stations: tuple[Rays, ...]


def find_moves(
    removed: Things, added: Things, resolution: float, up: tuple[float, float, float]
) -> list[Move]:
    """Match removed to added objects, one to one, where a rigid motion explains both.

    Args:
        removed: The objects of the reference scan.
        added: The objects of the current scan.
        resolution: Length below which the two scans cannot be told apart, m.
        up: Direction about which things are turned first; a motion may tilt from there.
    """
    candidates = _candidates(removed, added)
    if not candidates:
        return []
    moves = [_best_move(pair, removed, added, resolution, np.asarray(up)) for pair in candidates]
    likely = {(move.removed, move.added): move for move in moves if move.agreement > LEAST_AGREEMENT}
    gain = np.zeros((len(removed.points), len(added.points)))
    for place, move in likely.items():
        gain[place] = move.agreement
    rows, columns = linear_sum_assignment(gain, maximize=True)
    return [likely[place] for place in zip(rows.tolist(), columns.tolist(), strict=True) if place in likely]


def _candidates(removed: Things, added: Things) -> list[tuple[int, int]]:
    """Pairs of objects of similar size, the most similar first."""
    if not (removed.points and added.points):
        return []
    lengths = [_lengths(things) for things in (removed, added)]
    pairs = []
    for first, second in itertools.product(*lengths):
        ratio = min(lengths[0][first], lengths[1][second]) / max(lengths[0][first], lengths[1][second])
        if ratio >= LEAST_SIZE_RATIO:
            pairs.append((-ratio, first, second))
    return [(first, second) for _, first, second in sorted(pairs)[:MOST_CANDIDATES]]


def _lengths(things: Things) -> dict[int, float]:
    """Longest edge of the box of every object that is large enough to have a shape."""
    lengths = {
        index: float(OrientedBox.around(points).extent[0])
        for index, points in enumerate(things.points)
        if len(points) >= LEAST_POINTS
    }
    return {index: length for index, length in lengths.items() if length > 0}


def _best_move(pair: tuple[int, int], removed: Things, added: Things, resolution: float, up: Array) -> Move:
    """The motion of the highest agreement; a symmetric thing has several, and of these the one that turns least."""
    before = _View.of(removed.points[pair[0]], removed.stations, resolution)
    after = _View.of(added.points[pair[1]], added.stations, resolution)
    motions = _motions(before, after, resolution, up)
    agreements = _agreements(motions, before, after, resolution)
    cosines = np.trace(motions[:, :3, :3], axis1=1, axis2=2)  # 1 + 2 cos of the turn
    best = int(np.argmax(np.where(agreements >= agreements.max() - AS_GOOD, cosines, -np.inf)))
    return Move(*pair, motion=motions[best], agreement=float(agreements.max()))


@dataclass(frozen=True, eq=False)
class _View:
    """One object as one scan shows it.

    `sample` (n, 3) are points spread evenly over it, `tree` holds all of them, nearer to which than `tolerance` another
    view of the same surface has its points.
    """

    sample: Array
    tree: cKDTree
    tolerance: float
    stations: tuple[Rays, ...]

    @classmethod
    def of(cls, points: Array, stations: tuple[Rays, ...], resolution: float) -> _View:
        """A view of points (N, 3)."""
        dense = _thinned(points, DENSE_POINTS)
        return cls(_thinned(points, MOST_POINTS), cKDTree(dense), _tolerance(dense, resolution), stations)


def _thinned(points: Array, most: int) -> Array:
    """At most about `most` points, evenly over the surface: one per cube of a grid as fine as that allows."""
    if len(points) <= most:
        return points
    offsets = points - points.min(axis=0)
    low, high = 0.0, float(offsets.max())
    for _ in range(10):
        middle = (low + high) / 2
        if len(np.unique(_cubes(offsets, middle))) > most:
            low = middle
        else:
            high = middle
    return points[np.sort(np.unique(_cubes(offsets, high), return_index=True)[1])]


def _cubes(offsets: Array, side: float) -> NDArray[np.int64]:
    """Number of the cube of this side that holds each point (N,); offsets (N, 3) are not negative."""
    cells = np.floor(offsets / side).astype(np.int64)
    _, rows, columns = cells.max(axis=0) + 1
    return (cells[:, 0] * rows + cells[:, 1]) * columns + cells[:, 2]


def _tolerance(points: Array, resolution: float) -> float:
    """Distance from these points within which another view of the same surface has its own, m."""
    gaps, _ = cKDTree(points).query(points, k=[5])
    longest = float(np.ptp(points, axis=0).max())
    return min(max(TOLERANCE * float(np.median(gaps)), FINEST * resolution), COARSEST * longest)


def _motions(before: _View, after: _View, resolution: float, up: Array) -> Array:
    """Motions (S, 4, 4) of one view onto the other: many starts on few points, the best of them on all points."""
    source, target = before.sample, after.sample
    tolerance = max(before.tolerance, after.tolerance)
    boxes = [OrientedBox.around(points) for points in (source, target)]
    turns = np.concatenate([_turns_about(up), _between(*boxes)])
    shifts = [aim - turns @ anchor for anchor, aim in _anchors(boxes, (source, target))]
    rotations = torch.from_numpy(np.tile(turns, (len(shifts), 1, 1)))
    first = overlay(
        torch.from_numpy(_thinned(source, COARSE_POINTS)),
        torch.from_numpy(_thinned(target, COARSE_POINTS)),
        rotations,
        torch.from_numpy(np.concatenate(shifts)),
        2 * tolerance,
        COARSE_STEPS,
    )
    likely = first.best(LIKELY_STARTS, 1.5 * tolerance)
    agreements = torch.from_numpy(_agreements(_matrices(likely), before, after, resolution))
    kept = agreements.argsort(descending=True, stable=True)[:KEPT_STARTS]
    refined = overlay(
        torch.from_numpy(source),
        torch.from_numpy(target),
        torch.cat([first.rotations[:1], likely.rotations[kept]]),  # the first start does not turn
        torch.cat([first.shifts[:1], likely.shifts[kept]]),
        2 * tolerance,
        FINE_STEPS,
    )
    return _matrices(refined)


def _anchors(boxes: Sequence[OrientedBox], points: Sequence[Array]) -> list[tuple[Array, Array]]:
    """Places of two views, (3,) each, that may be one place: their middles; where one is longer, its ends' as well."""
    middles = [box.center for box in boxes]
    anchors = [(middles[0], middles[1]), (np.median(points[0], axis=0), np.median(points[1], axis=0))]
    slack = (boxes[1].extent[0] - boxes[0].extent[0]) / 2
    longer = int(slack > 0)
    if abs(slack) > UNEQUAL * boxes[longer].extent[0]:
        for end in (-1, 1):
            anchor = list(middles)
            anchor[longer] = middles[longer] + end * abs(slack) * boxes[longer].rotation[:, 0]
            anchors.append((anchor[0], anchor[1]))
    return anchors


def _matrices(overlays: Overlays) -> Array:
    """The motions as matrices (S, 4, 4)."""
    motions = np.tile(np.eye(4), (len(overlays.shifts), 1, 1))
    motions[:, :3, :3], motions[:, :3, 3] = overlays.rotations.numpy(), overlays.shifts.numpy()
    return motions


def _turns_about(up: Array) -> Array:
    """Rotations (S, 3, 3) about `up` (Rodrigues)."""
    x, y, z = up / np.linalg.norm(up)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angles = np.radians(np.arange(0.0, 360.0, TURN_STEP))[:, None, None]
    return np.eye(3) + np.sin(angles) * cross + (1 - np.cos(angles)) * (cross @ cross)


def _between(first: OrientedBox, second: OrientedBox) -> Array:
    """The four rotations (4, 3, 3) that lay the axes of one box on those of the other."""
    signs = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return (second.rotation * signs[:, None]) @ first.rotation.T


def _agreements(motions: Array, before: _View, after: _View, resolution: float) -> Array:
    """Share of points on the other's surface, less what contradicts, for each motion (S, 4, 4): (S,).

    At most 0 where a view shares too little with the other to tell anything.
    """
    rotations, shifts = motions[:, :3, :3], motions[:, None, :3, 3]
    moved = before.sample @ rotations.transpose(0, 2, 1) + shifts, after  # (S, A, 3)
    back = (after.sample - shifts) @ rotations, before  # (S, B, 3)
    lying = [view.tree.query(places)[0] < view.tolerance for places, view in (moved, back)]
    against = [
        _contradictions(places, on, view.stations, resolution)
        for (places, view), on in zip((moved, back), lying, strict=True)
    ]
    shares = [on.mean(axis=1) for on in lying]
    agreements: Array = np.maximum(*shares) - np.maximum(*against)
    return np.where(np.minimum(*shares) >= LEAST_SHARED, agreements, np.minimum(agreements, 0.0))


def _contradictions(
    places: Array, lying: NDArray[np.bool_], stations: tuple[Rays, ...], resolution: float
) -> Array:
    """Twice the share of places (S, A, 3) off the thing that the scan saw to be empty; without rays, those off it."""
    if not stations:
        return (~lying).mean(axis=1)
    sights = joint_sights(stations, places.reshape(-1, 3), SEEN_THROUGH * resolution).reshape(lying.shape)
    return 2.0 * (~lying & (sights == Sight.SEEN_THROUGH)).mean(axis=1)
