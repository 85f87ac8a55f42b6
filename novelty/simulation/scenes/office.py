"""An office."""

from __future__ import annotations

import numpy as np

from novelty.simulation.poses import FloatArray, make_pose
from novelty.simulation.scenes import furniture
from novelty.simulation.scenes.scene import Scene
from novelty.simulation.scenes.site import Site
from novelty.simulation.shapes import block


def make_office(seed: int = 0) -> Scene:
    """An office about 9 m x 7 m: six desks with screens and chairs, shelves, a cabinet, a column, a window, a door."""
    rng = np.random.default_rng(seed)
    length, width, height = rng.uniform(8.5, 9.5), rng.uniform(6.5, 7.5), 2.8
    site = Site()
    site.room_shell(length, width, height, door_at=length - 2.6, swing=rng.uniform(-95, -65))
    for number in range(6):
        x = 2.4 + 2.4 * (number // 2)
        _desk(site, number + 1, np.array([x, (1 if number % 2 else -1) * width * 0.24]), rng)
    for number, y in enumerate((-1.3, 0.0, 1.3)):
        shelf = furniture.shelf(seed=int(rng.integers(2**31)))
        site.add(f"shelf {number + 1}", shelf, make_pose((length - 0.01, y, 0), yaw=180), movable=True)
    site.add(
        "cabinet", furniture.cabinet(height=1.4), make_pose((2.2, -width / 2 + 0.01, 0), yaw=90), movable=True
    )
    site.add("column", block(0.35, 0.35, height), make_pose((length * 0.6, 0, 0)))
    site.ceiling_lamps([(x, y) for x in (2.2, 4.6, 7.0) for y in (-width / 4, width / 4)], height)
    floor = np.array([[0.6, -width / 2 + 0.4], [length - 0.6, width / 2 - 0.4]])
    return site.scene("office", floor, make_pose((0.9, rng.uniform(-0.3, 0.3), 1.3)))


def _desk(site: Site, number: int, place: FloatArray, rng: np.random.Generator) -> None:
    """A desk with a screen and, on one long side, its chair."""
    pose = make_pose((*place, 0), yaw=rng.uniform(-4, 4))
    site.add(f"desk {number}", furniture.table(1.6, 0.8), pose)
    screen = pose @ make_pose((rng.uniform(-0.3, 0.3), 0.2, 0.74), yaw=-90 + rng.uniform(-20, 20))
    site.add(f"screen {number}", furniture.monitor(), screen, movable=True)
    seat = pose @ make_pose(
        (rng.uniform(-0.3, 0.3), -rng.uniform(0.6, 0.9), 0), yaw=90 + rng.uniform(-40, 40)
    )
    site.add(f"chair {number}", furniture.office_chair(), seat, movable=True)
