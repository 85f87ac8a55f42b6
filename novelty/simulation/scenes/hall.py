"""An entrance hall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from novelty.simulation.poses import make_pose
from novelty.simulation.scenes import furniture
from novelty.simulation.scenes.scene import Scene
from novelty.simulation.scenes.site import Site
from novelty.simulation.shapes import Opening, box, cylinder


def make_hall(seed: int = 0) -> Scene:
    """An entrance hall of about 15 m x 8 m: round columns, a glass front, a counter, benches, plants, four doors."""
    rng = np.random.default_rng(seed)
    length, width, height = rng.uniform(14, 16), rng.uniform(7.5, 8.5), 3.8
    site = Site()
    _shell(site, length, width, height, rng)
    for number, (x, side) in enumerate((x, side) for x in (0.35, 0.7) for side in (-1, 1)):
        place = (length * x, side * width * 0.27, 0)
        site.add(f"column {number + 1}", cylinder(0.25, height), make_pose(place))
    _furnish(site, length, width, rng)
    site.ceiling_lamps([(x, y) for x in np.arange(2.0, length, 3.0) for y in (-2.0, 2.0)], height)
    floor = np.array([[0.5, -width / 2 + 0.2], [length - 0.5, width / 2 - 0.2]])
    viewpoint = make_pose((rng.uniform(3.0, 4.0), rng.uniform(-0.4, 0.4), 1.0))
    path = np.array([[1.0, -0.4], [length - 1.0, -0.4], [length - 1.0, 0.4], [1.0, 0.4]])
    return replace(site.scene("hall", floor, viewpoint), path=path)


def _shell(site: Site, length: float, width: float, height: float, rng: np.random.Generator) -> None:
    """Floor, ceiling, walls with two doors on either side, and a front of glass at the far end."""
    site.shell(length, width, height, beyond=2.0)
    for side in ("left", "right"):
        doors = np.array([5.2, 9.5]) + rng.uniform(-0.6, 0.6, 2)
        site.long_wall(side, length, width, height, doors.tolist(), swing=-rng.uniform(65, 95))
        site.far_side(side, length, width, height, 2.0)
    site.end_wall("near wall", (0, -width / 2), 90, width, height)
    panes = [Opening(start, 1.3, 0.1, 2.9) for start in np.arange(0.5, width - 1.4, 1.45)]
    site.glazed_wall(
        "glass front", make_pose((length, width / 2, 0), yaw=-90), width, height, panes, "front glass"
    )


def _furnish(site: Site, length: float, width: float, rng: np.random.Generator) -> None:
    counter = make_pose((length * 0.55, width * 0.36, 0), yaw=-90 + rng.uniform(-10, 10))
    site.add("counter", furniture.counter(), counter)
    for number, x in enumerate((3.4, 8.0)):
        place = make_pose((x + rng.uniform(-0.2, 0.2), -width / 2 + 0.05, 0), yaw=90)
        site.add(f"bench {number + 1}", furniture.bench(), place, movable=True)
    for number, side in enumerate((-1, 1)):
        plant = furniture.plant(rng.uniform(1.2, 1.6), seed=int(rng.integers(2**31)))
        site.add(
            f"plant {number + 1}",
            plant,
            make_pose((length * 0.35, side * (width * 0.27 + 0.75), 0)),
            movable=True,
        )
    site.add("bin", furniture.waste_bin(), make_pose((6.5, width / 2 - 0.4, 0)), movable=True)
    sign = box((-0.02, -0.35, 0), (0.02, 0.35, 1.8))
    turned = make_pose((length * 0.45, -width * 0.3, 0), yaw=rng.uniform(-40, 40))
    site.add("sign", sign, turned, movable=True)
