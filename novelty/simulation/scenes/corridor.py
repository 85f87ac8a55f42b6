"""A corridor between rooms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from novelty.simulation.meshes import Mesh
from novelty.simulation.poses import make_pose
from novelty.simulation.scenes import furniture
from novelty.simulation.scenes.scene import Scene
from novelty.simulation.scenes.site import DOOR_WIDTH, Site
from novelty.simulation.shapes import box, cylinder, pipe


def make_corridor(seed: int = 0) -> Scene:
    """A corridor of about 12 m x 2.5 m: four doors to side rooms, a window, lamps, a pipe, things along the walls."""
    rng = np.random.default_rng(seed)
    length, width, height = rng.uniform(11, 13), rng.uniform(2.3, 2.7), 2.7
    starts = {side: np.array([3.4, 8.2]) + rng.uniform(-0.6, 0.6, 2) for side in ("left", "right")}
    site = Site()
    site.shell(length, width, height, beyond=3.0)
    for side, doors in starts.items():
        site.long_wall(side, length, width, height, doors.tolist(), swing=-rng.uniform(65, 95))
    site.end_wall("near wall", (0, -width / 2), 90, width, height)
    site.end_wall("far wall", (length, width / 2), -90, width, height, window=True)
    site.outer_walls(length, width, height, beyond=3.0)
    site.ceiling_lamps([(x, 0.0) for x in np.arange(1.5, length, 2.4)], height)
    site.add("pipe", pipe((0.0, 0, 0), (length, 0, 0), 0.05), make_pose((0, width / 2 - 0.12, height - 0.12)))
    _furnish_corridor(site, starts, length, width, rng)
    floor = np.array([[0.4, -width / 2 + 0.1], [length - 0.4, width / 2 - 0.1]])
    viewpoint = make_pose((rng.uniform(1.2, 1.8), rng.uniform(-0.3, 0.3), 1.0))
    path = np.array([[0.6, -0.18 * width], [length - 0.6, -0.18 * width], [0.6, -0.18 * width]])
    return replace(site.scene("corridor", floor, viewpoint), path=path)


def _furnish_corridor(
    site: Site,
    doors: Mapping[str, NDArray[np.float64]],
    length: float,
    width: float,
    rng: np.random.Generator,
) -> None:
    """Stand one or two things into every stretch of wall between the doors."""
    makers: list[tuple[str, Callable[[], Mesh]]] = [
        ("cabinet", furniture.cabinet),
        ("bench", furniture.bench),
        ("radiator", furniture.radiator),
        ("plant", lambda: furniture.plant(seed=int(rng.integers(2**31)))),
        ("bin", furniture.waste_bin),
        ("shelf", lambda: furniture.shelf(0.9, 0.28, seed=int(rng.integers(2**31)))),
    ]
    order = rng.permutation(len(makers))
    slots = [(side, place) for side, starts in doors.items() for place in _stretches(starts, length)]
    for (side, place), index in zip(slots, order, strict=True):
        name, make = makers[index]
        inset = 0.22 if name in {"plant", "bin"} else 0.01
        y, yaw = (width / 2 - inset, -90.0) if side == "left" else (-width / 2 + inset, 90.0)
        site.add(name, make(), make_pose((place, y, 0), yaw=yaw), movable=name != "radiator")
    board = box((0, 0, 0), (1.2, 0.02, 0.8))
    site.add("notice board", board, make_pose((doors["left"][0] + 1.6, width / 2 - 0.03, 1.2)))
    extinguisher = make_pose((doors["right"][0] - 0.5, -width / 2 + 0.1, 0.7))
    site.add("extinguisher", cylinder(0.08, 0.5, sides=16), extinguisher, movable=True)


def _stretches(starts: NDArray[np.float64], length: float) -> list[float]:
    """Middles of the three stretches of wall before, between and after two doors."""
    return [
        float(starts[0]) - 1.3,
        float(starts.mean() + DOOR_WIDTH / 2),
        float(starts[1] + DOOR_WIDTH + length) / 2,
    ]
