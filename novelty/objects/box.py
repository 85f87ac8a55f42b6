"""Oriented boxes: small, aligned with flat sides where there are any, and not stretched by a few strays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

Array = NDArray[np.float64]

SAMPLE = 1500
"""Points that a box is fitted to at most; more would only cost time."""

STRAY_NEIGHBOURS = 4
STRAY_RATIO = 5.0
"""A point is a stray when its fourth neighbour is this many times farther than is usual in the object."""

MAX_STRAYS = 0.02
"""Share of an object's points that can be strays; more than that is a part of it."""

NORMALS = 24
"""Directions tried for the box's faces: those in which the hull's largest facets look."""

TURNS = np.radians(np.arange(0.0, 90.0, 5.0))
"""Turns about each of these directions that are tried first; the best is refined."""


@dataclass(frozen=True, eq=False)
class OrientedBox:
    """A box: `center` (3,), `extent` (3,) longest edge first, `rotation` (3, 3) with the box's axes as columns."""

    center: Array
    extent: Array
    rotation: Array

    @classmethod
    def around(cls, points: Array) -> OrientedBox:
        """The box of points (N, 3), N >= 1, whose three edges are shortest in sum.

        Of two boxes with the same volume the one with the shorter edges lies along the sides: a corner of a carton,
        seen from one side, fills half of its own box and half of the box along the diagonal.
        """
        kept = _without_strays(_thinned(points))
        axes = _principal_axes(kept)
        corners = _hull(kept)
        if corners is not None:
            axes = _shortest_edges(corners.points[corners.vertices], _directions(corners, axes))
        axes = axes[:, np.argsort(-np.ptp(kept @ axes, axis=0), kind="stable")]
        if np.linalg.det(axes) < 0:
            axes[:, 2] = -axes[:, 2]
        along = kept @ axes  # (M, 3)
        middle = (along.min(axis=0) + along.max(axis=0)) / 2
        return cls(center=axes @ middle, extent=np.ptp(along, axis=0), rotation=axes)


def _thinned(points: Array) -> Array:
    if len(points) <= SAMPLE:
        return points
    return points[np.random.default_rng(0).choice(len(points), SAMPLE, replace=False)]


def _without_strays(points: Array) -> Array:
    """The points (M, 3) without the few that have no company."""
    if len(points) <= 10 * STRAY_NEIGHBOURS:
        return points
    distances, _ = cKDTree(points).query(points, k=[STRAY_NEIGHBOURS + 1])
    lonely = distances[:, 0] > STRAY_RATIO * np.median(distances)
    return points[~lonely] if lonely.mean() <= MAX_STRAYS else points


def _principal_axes(points: Array) -> Array:
    mean = points.mean(axis=0)
    return np.linalg.eigh((points - mean).T @ (points - mean))[1]


def _hull(points: Array) -> ConvexHull | None:
    """The convex hull; None for points that lie in a plane or are fewer than a body needs."""
    try:
        return ConvexHull(points - points.mean(axis=0))
    except (QhullError, ValueError):
        return None


def _directions(hull: ConvexHull, axes: Array) -> Array:
    """Unit vectors (F, 3) that a face of the box may look in: the principal axes and the largest facets' normals."""
    edges = hull.points[hull.simplices]
    areas = np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1)
    largest = np.argsort(-areas)[:NORMALS]
    return np.concatenate([axes.T, hull.equations[largest, :3]])


def _shortest_edges(corners: Array, normals: Array) -> Array:
    """The axes (3, 3) of the box around `corners` (V, 3) with the least sum of edges, one face along a normal."""
    frames = _frames(normals)  # (F, 3, 3)
    best, turn = _best_turn(corners, frames, TURNS)
    fine = turn + np.linspace(-TURNS[1], TURNS[1], 25)
    _, turn = _best_turn(corners, frames[best : best + 1], fine)
    return frames[best] @ _about_third(np.array([turn]))[0]


def _best_turn(corners: Array, frames: Array, turns: Array) -> tuple[int, float]:
    """Frame and turn about its third axis that give the least sum of edges."""
    along = corners @ frames  # (F, V, 3)
    plane = along[:, None, :, :2] @ _about_third(turns)[None, :, :2, :2]  # (F, A, V, 2)
    edges = np.ptp(plane, axis=2).sum(axis=2) + np.ptp(along[:, :, 2], axis=1)[:, None]  # (F, A)
    frame, turn = np.unravel_index(np.argmin(edges), edges.shape)
    return int(frame), float(turns[turn])


def _frames(normals: Array) -> Array:
    """A rotation (F, 3, 3) for each normal, which is its third column."""
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first), normals], axis=2)


def _about_third(turns: Array) -> Array:
    """Rotations (A, 3, 3) about the third axis."""
    matrices = np.zeros((len(turns), 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(turns)
    matrices[:, 1, 0], matrices[:, 0, 1] = np.sin(turns), -np.sin(turns)
    matrices[:, 2, 2] = 1.0
    return matrices
