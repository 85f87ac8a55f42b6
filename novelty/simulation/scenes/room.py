"""A living room."""

from __future__ import annotations

import numpy as np

from novelty.simulation.meshes import Mesh
from novelty.simulation.poses import FloatArray, make_pose
from novelty.simulation.scenes import furniture
from novelty.simulation.scenes.scene import Scene
from novelty.simulation.scenes.site import Site


def make_room(seed: int = 0) -> Scene:
    """A living room about 6 m x 5 m: table and chairs, sofa, shelf, cabinet, plant, a window, a radiator, a door."""
    rng = np.random.default_rng(seed)
    length, width, height = rng.uniform(5.5, 6.5), rng.uniform(4.5, 5.5), 2.6
    site = Site()
    site.room_shell(length, width, height, door_at=length - 2.0, swing=rng.uniform(-95, -65))
    table = np.array([length * 0.55, width * rng.uniform(-0.1, 0.1)])
    site.add(
        "table", furniture.table(1.5, 0.8), make_pose((*table, 0), yaw=rng.uniform(-20, 20)), movable=True
    )
    for number, angle in enumerate((20, 160, 250, 300)):
        _chair_at_table(
            site, f"chair {number + 1}", furniture.chair(), table, angle + rng.uniform(-12, 12), 0.95
        )
    site.add("sofa", furniture.sofa(), make_pose((length * 0.4, width / 2 - 0.02, 0), yaw=-90), movable=True)
    shelf = furniture.shelf(1.2, seed=int(rng.integers(2**31)))
    site.add("shelf", shelf, make_pose((length - 0.01, width * 0.2, 0), yaw=180), movable=True)
    cabinet = make_pose((length * 0.35, -width / 2 + 0.01, 0), yaw=90)
    site.add("cabinet", furniture.cabinet(), cabinet, movable=True)
    plant = furniture.plant(seed=int(rng.integers(2**31)))
    site.add("plant", plant, make_pose((length - 0.5, width / 2 - 0.5, 0)), movable=True)
    site.ceiling_lamps([(length / 2, 0.0)], height)
    floor = np.array([[0.4, -width / 2 + 0.3], [length - 0.4, width / 2 - 0.3]])
    viewpoint = make_pose((0.7, rng.uniform(-0.6, 0.2), 1.2))
    return site.scene("room", floor, viewpoint)


def _chair_at_table(site: Site, name: str, mesh: Mesh, table: FloatArray, angle: float, reach: float) -> None:
    x, y = table + reach * np.array([np.cos(np.radians(angle)), 0.8 * np.sin(np.radians(angle))])
    site.add(name, mesh, make_pose((x, y, 0), yaw=angle + 180), movable=True)
