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

LEAST_AGREEMENT = 0.8
"""Agreement above which two objects are one that was moved."""

AS_GOOD = 0.03
"""Motions whose agreement is this near the best are equally good: of these, the one that turns least is told."""

LEAST_SIZE_RATIO = 0.8
"""The longest edges of the two boxes may differ by this factor: one side of a thing may hide a part of it."""

LEAST_POINTS = 50
"""Fewer points have no shape."""

MOST_POINTS = 250
"""Points of an object that are laid over each other."""

DENSE_POINTS = 2000
"""Points of an object that others are measured against."""

COARSE_POINTS = 120
COARSE_STEPS, FINE_STEPS = 14, 12
KEPT_STARTS = 6
"""Motions that are refined; the first look takes fewer points and steps."""

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
        agreement: How well the two views of it fit, 1 at best.
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
    overlays = _overlays(before.sample, after.sample, max(before.tolerance, after.tolerance), up)
    motions = np.tile(np.eye(4), (len(overlays.shifts), 1, 1))
    motions[:, :3, :3], motions[:, :3, 3] = overlays.rotations.numpy(), overlays.shifts.numpy()
    agreements = np.array([_agreement(motion, before, after, resolution) for motion in motions])
    cosines = np.trace(motions[:, :3, :3], axis1=1, axis2=2)  # 1 + 2 cos of the turn
    best = int(np.argmax(np.where(agreements >= agreements.max() - AS_GOOD, cosines, -np.inf)))
    return Move(*pair, motion=motions[best], agreement=float(agreements[best]))


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


def _overlays(source: Array, target: Array, tolerance: float, up: Array) -> Overlays:
    """Motions of `source` onto `target`: many starts on few points, the best of them on all points."""
    boxes = [OrientedBox.around(points) for points in (source, target)]
    rotations = np.concatenate([_turns_about(up), _between(*boxes)])
    shifts = boxes[1].center - rotations @ boxes[0].center
    first = overlay(
        torch.from_numpy(_thinned(source, COARSE_POINTS)),
        torch.from_numpy(_thinned(target, COARSE_POINTS)),
        torch.from_numpy(rotations),
        torch.from_numpy(shifts),
        2 * tolerance,
        COARSE_STEPS,
    )
    kept = first.best(KEPT_STARTS, 1.5 * tolerance)
    return overlay(
        torch.from_numpy(source),
        torch.from_numpy(target),
        torch.cat([first.rotations[:1], kept.rotations]),  # the first start does not turn
        torch.cat([first.shifts[:1], kept.shifts]),
        2 * tolerance,
        FINE_STEPS,
    )


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


def _agreement(motion: Array, before: _View, after: _View, resolution: float) -> float:
    """Share of points on the other's surface, less what contradicts."""
    rotation, shift = motion[:3, :3], motion[:3, 3]
    moved = before.sample @ rotation.T + shift, after
    back = (after.sample - shift) @ rotation, before
    lying = [view.tree.query(places)[0] < view.tolerance for places, view in (moved, back)]
    against = [
        _contradicts(places, on, view.stations, resolution)
        for (places, view), on in zip((moved, back), lying, strict=True)
    ]
    return float(max(on.mean() for on in lying) - max(against))


def _contradicts(
    places: Array, lying: NDArray[np.bool_], stations: tuple[Rays, ...], resolution: float
) -> float:
    """Twice the share of places off the thing that the scan saw to be empty; without rays, those off the thing."""
    if not stations:
        return float((~lying).mean())
    empty = joint_sights(stations, places, SEEN_THROUGH * resolution) == Sight.SEEN_THROUGH
    return 2 * float((~lying & empty).mean())
