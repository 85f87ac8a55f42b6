"""Ideal surfaces for point clouds that no sensor measured: the corridor of Fig. 5, the relief of Fig. 4."""

from __future__ import annotations

import numpy as np

from novelty.simulation.meshes import Mesh
from novelty.simulation.poses import make_pose
from novelty.simulation.scenes.scene import Scene
from novelty.simulation.scenes.site import Site

CORRIDOR = (4.0, 2.0, 3.2)
"""Length, width and height, m: the proportions of Fig. 5, whose axes have no unit, with room for an object."""

RELIEF = 2.0
"""Side of the relief, m."""


def make_ideal_corridor(seed: int = 0) -> Scene:
    """Two walls and a ceiling as plain rectangles (Fig. 5); the seed changes nothing."""
    length, width, height = CORRIDOR
    site = Site()
    for side, y in (("right", -width / 2), ("left", width / 2)):
        site.add(f"{side} wall", _rectangle((0, y, 0), (length, 0, 0), (0, 0, height)), np.eye(4))
    site.add("ceiling", _rectangle((0, -width / 2, height), (length, 0, 0), (0, width, 0)), np.eye(4))
    floor = np.array([[0.3, -width / 2 + 0.2], [length - 0.3, width / 2 - 0.2]])
    return site.scene("ideal_corridor", floor, make_pose((0.4, 0.0, 1.0)))


def make_relief(seed: int = 0) -> Scene:
    """A flat plate with a few round hills of different steepness, drawn by the seed (Fig. 4)."""
    rng = np.random.default_rng(seed)
    grid = np.linspace(0.0, RELIEF, 161)
    x, y = np.meshgrid(grid, grid, indexing="ij")
    z = np.zeros_like(x)
    for centre in ((0.55, 0.55), (1.45, 0.6), (0.6, 1.45), (1.4, 1.4)):
        u, v = centre + rng.uniform(-0.1, 0.1, 2)
        height, radius = rng.uniform(0.1, 0.25), rng.uniform(0.07, 0.18)
        z += height * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * radius**2))
    site = Site()
    site.add("relief", _height_field(x, y, z), np.eye(4))
    floor = np.array([[0.0, 0.0], [RELIEF, RELIEF]])
    return site.scene("relief", floor, make_pose((-1.0, RELIEF / 2, 1.5), pitch=40))


def _rectangle(corner: tuple[float, ...], first: tuple[float, ...], second: tuple[float, ...]) -> Mesh:
    """The rectangle from `corner` along two edges, (3,) each."""
    low, u, v = (np.array(part, dtype=np.float64) for part in (corner, first, second))
    return Mesh([low, low + u, low + u + v, low + v], [[0, 1, 2], [0, 2, 3]])


def _height_field(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Mesh:
    """The surface through a grid (rows, columns) of points."""
    index = np.arange(x.size).reshape(x.shape)
    corners = [part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])]
    faces = [np.stack([corners[0], corners[step], corners[step + 1]], axis=1) for step in (1, 2)]
    return Mesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), np.concatenate(faces))
