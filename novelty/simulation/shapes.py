"""Parametric solids as triangle meshes: boxes, cylinders, capsules, walls with openings; in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.simulation.meshes import Mesh, join

_BOX_FACES = np.array(
    [
        *([0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4]),
        *([1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]),
    ]
)


def box(low: ArrayLike, high: ArrayLike) -> Mesh:
    """The axis-aligned box between two corners, (3,) each."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    base = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    return Mesh([[*corner, z] for z in (z0, z1) for corner in base], _BOX_FACES)


def block(length: float, width: float, height: float, base: float = 0.0) -> Mesh:
    """A box centred on the z axis that stands on z = `base`."""
    return box((-length / 2, -width / 2, base), (length / 2, width / 2, base + height))


def tube(
    start: ArrayLike, end: ArrayLike, radii: Sequence[float], stations: Sequence[float], sides: int = 20
) -> Mesh:
    """A surface of revolution about the line from `start` to `end`, closed at both ends.

    Args:
        start: (3,), m.
        end: (3,), m.
        radii: Radius at each station, m.
        stations: Where along the line each radius holds, m from `start`; increasing, may overshoot.
        sides: Corners of each ring.
    """
    first, last = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    axis, side, up = _frame(last - first)
    angles = 2 * np.pi * np.arange(sides) / sides
    circle = np.outer(np.cos(angles), side) + np.outer(np.sin(angles), up)
    rings = [first + s * axis + r * circle for r, s in zip(radii, stations, strict=True)]
    ends = [first + stations[0] * axis, first + stations[-1] * axis]
    return Mesh(np.concatenate([*rings, ends]), _tube_faces(len(rings), sides))


def cylinder(radius: float, height: float, sides: int = 32) -> Mesh:
    """An upright cylinder that stands on z = 0."""
    return tube((0, 0, 0), (0, 0, height), [radius, radius], [0, height], sides)


def pipe(start: ArrayLike, end: ArrayLike, radius: float) -> Mesh:
    """A straight pipe between two points, (3,) each."""
    length = float(np.linalg.norm(np.subtract(end, start)))
    return tube(start, end, [radius, radius], [0, length])


def capsule(
    start: ArrayLike, end: ArrayLike, radius: float, end_radius: float | None = None, sides: int = 20
) -> Mesh:
    """A rod between two points (3,) with round ends, tapering to `end_radius` where given."""
    length = float(np.linalg.norm(np.subtract(end, start)))
    last = radius if end_radius is None else end_radius
    angles = np.linspace(0.05, 1.0, 6) * np.pi / 2
    radii = np.concatenate([radius * np.sin(angles), last * np.sin(angles[::-1])])
    stations = np.concatenate([-radius * np.cos(angles), length + last * np.cos(angles[::-1])])
    return tube(start, end, radii.tolist(), stations.tolist(), sides)


def sphere(centre: ArrayLike, radius: float) -> Mesh:
    """A sphere about `centre` (3,)."""
    top = np.asarray(centre, dtype=float) + np.array([0, 0, 1e-3])
    return capsule(centre, top, radius)


@dataclass(frozen=True)
class Opening:
    """A hole in a wall: `start` to `start + width` along the wall, `bottom` to `top` in height (m)."""

    start: float
    width: float
    bottom: float = 0.0
    top: float = 2.05


def wall(length: float, height: float, thickness: float = 0.12, openings: Sequence[Opening] = ()) -> Mesh:
    """A wall with openings, along +x from the origin; its inner face is y = 0, its body y > 0."""
    parts, reached = [], 0.0
    for gap in sorted(openings, key=lambda opening: opening.start):
        parts.append((reached, gap.start, 0.0, height))
        parts.append((gap.start, gap.start + gap.width, 0.0, gap.bottom))
        parts.append((gap.start, gap.start + gap.width, gap.top, height))
        reached = gap.start + gap.width
    parts.append((reached, length, 0.0, height))
    return join(box((x0, 0, z0), (x1, thickness, z1)) for x0, x1, z0, z1 in parts if x1 > x0 and z1 > z0)


def _frame(
    direction: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    axis = direction / np.linalg.norm(direction)
    side = np.cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side)
    return axis, side, np.cross(axis, side)


def _tube_faces(rings: int, sides: int) -> NDArray[np.int64]:
    here = np.arange(sides)
    following = (here + 1) % sides
    faces = []
    for ring in range(rings - 1):
        low, high = ring * sides, (ring + 1) * sides
        faces.append(np.stack([low + here, low + following, high + following], axis=1))
        faces.append(np.stack([low + here, high + following, high + here], axis=1))
    bottom, top = rings * sides, rings * sides + 1
    faces.append(np.stack([np.full(sides, bottom), following, here], axis=1))
    last = (rings - 1) * sides
    faces.append(np.stack([np.full(sides, top), last + here, last + following], axis=1))
    return np.concatenate(faces)
