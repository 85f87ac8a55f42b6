"""A laboratory."""

from __future__ import annotations

import numpy as np

from novelty.simulation.poses import make_pose
from novelty.simulation.scenes import furniture
from novelty.simulation.scenes.scene import Scene
from novelty.simulation.scenes.site import Site
from novelty.simulation.shapes import block, pipe


def make_lab(seed: int = 0) -> Scene:
    """A laboratory of about 10 m x 7 m: workbenches, instruments, stools, gas bottles, pipes, cabinets, a machine."""
    rng = np.random.default_rng(seed)
    length, width, height = rng.uniform(9.5, 10.5), rng.uniform(6.5, 7.5), 3.0
    site = Site()
    site.room_shell(length, width, height, door_at=rng.uniform(3.8, 4.4), swing=rng.uniform(-95, -65))
    for number, x in enumerate((2.2, 4.4)):
        _bench(site, number + 1, (x, width / 2 - 0.02), -90, rng)
    for number, y in enumerate((-1.4, 1.4)):
        _bench(site, number + 3, (length - 0.02, y), 180, rng)
    _machine(site, length, rng)
    _services(site, length, width, height, rng)
    site.ceiling_lamps([(x, y) for x in (2.5, 5.0, 7.5) for y in (-1.6, 1.6)], height)
    floor = np.array([[0.5, -width / 2 + 0.4], [length - 0.9, width / 2 - 0.9]])
    return site.scene("lab", floor, make_pose((0.8, rng.uniform(-0.4, 0.4), 1.2)))


def _bench(site: Site, number: int, place: tuple[float, float], yaw: float, rng: np.random.Generator) -> None:
    """A workbench with its back at a place, two instruments on it and a stool before it."""
    frame = make_pose((*place, 0), yaw)
    site.add(f"workbench {number}", furniture.workbench(), frame)
    for side, letter in ((-1, "a"), (1, "b")):
        device = furniture.instrument(*rng.uniform((0.35, 0.25, 0.15), (0.6, 0.4, 0.4)))
        on_top = make_pose((0.12, side * rng.uniform(0.35, 0.5), 0.9), yaw=rng.uniform(-10, 10))
        site.add(f"instrument {number}{letter}", device, frame @ on_top, movable=True)
    before = frame @ make_pose((rng.uniform(1.0, 1.25), rng.uniform(-0.4, 0.4), 0))
    site.add(f"stool {number}", furniture.stool(), before, movable=True)


def _machine(site: Site, length: float, rng: np.random.Generator) -> None:
    """A machine on its base in the middle, with an arm, and a trolley beside it."""
    middle = make_pose((length * 0.62, rng.uniform(-0.3, 0.3), 0), yaw=rng.uniform(-30, 30))
    site.add("machine base", block(1.1, 0.9, 0.7), middle)
    site.add("machine column", block(0.35, 0.4, 1.1, 0.7), middle @ make_pose((-0.25, 0, 0)))
    site.add("machine arm", block(0.9, 0.25, 0.3, 1.5), middle @ make_pose((0.1, 0, 0)))
    beside = middle @ make_pose((0.2, -1.4, 0), yaw=rng.uniform(-20, 20))
    site.add("trolley", furniture.trolley(), beside, movable=True)


def _services(site: Site, length: float, width: float, height: float, rng: np.random.Generator) -> None:
    """Cabinets, gas bottles, and pipes under the ceiling and down the wall."""
    for number, x in enumerate((1.5, 2.6)):
        cabinet = make_pose((x, -width / 2 + 0.01, 0), yaw=90)
        site.add(f"cabinet {number + 1}", furniture.cabinet(1.0, 0.5, 1.95), cabinet, movable=True)
    for number in range(3):
        bottle = make_pose((6.0 + 0.28 * number, -width / 2 + 0.16, 0), yaw=rng.uniform(0, 360))
        site.add(f"gas bottle {number + 1}", furniture.gas_bottle(), bottle, movable=True)
    for number, offset in enumerate((0.15, 0.32, 0.5)):
        y, z = -width / 2 + offset, height - 0.18
        site.add(
            f"ceiling pipe {number + 1}", pipe((0, y, z), (length, y, z), 0.03 + 0.015 * number), np.eye(4)
        )
    down = (7.2, -width / 2 + 0.08)
    site.add("riser", pipe((*down, 0), (*down, height), 0.05), np.eye(4))
