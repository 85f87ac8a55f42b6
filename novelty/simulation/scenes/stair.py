"""A stairwell with its lobby."""

from __future__ import annotations

import numpy as np

from novelty.simulation.poses import make_pose
from novelty.simulation.scenes import furniture
from novelty.simulation.scenes.scene import Scene
from novelty.simulation.scenes.site import Site
from novelty.simulation.shapes import Opening, box, cylinder

STEPS = 9
RUN, RISE = 0.28, 0.175


def make_stair(seed: int = 0) -> Scene:
    """A lobby of about 5 m x 3.4 m, two doors, and stairs in two flights with a landing, handrails and a window."""
    rng = np.random.default_rng(seed)
    lobby, width, height = rng.uniform(4.8, 5.4), rng.uniform(3.2, 3.6), 5.8
    site = Site()
    end = lobby + STEPS * RUN + 1.3
    _walls(site, lobby, end, width, height, rng)
    _flights(site, lobby, end, width)
    _furnish(site, lobby, width, rng)
    floor = np.array([[0.3, -width / 2 + 0.15], [lobby - 0.2, width / 2 - 0.15]])
    return site.scene("stair", floor, make_pose((0.5, rng.uniform(-0.3, 0.3), 1.1)))


def _walls(
    site: Site, lobby: float, end: float, width: float, height: float, rng: np.random.Generator
) -> None:
    """Walls of the lobby and the well, a slab over the lobby, a window above the landing."""
    site.shell(end, width, height, beyond=1.6)
    doors = [float(rng.uniform(1.6, 2.0))]
    for side in ("left", "right"):
        site.long_wall(side, end, width, height, doors, swing=-rng.uniform(65, 95))
        site.far_side(side, end, width, height, 1.6)
    upper = 2 * STEPS * RISE
    site.add("upper floor", box((-0.1, -width / 2, upper - 0.2), (lobby, width / 2, upper)), np.eye(4))
    site.end_wall("near wall", (0, -width / 2), 90, width, height)
    pane = Opening(width * 0.25, width * 0.5, STEPS * RISE + 0.9, STEPS * RISE + 2.3)
    site.glazed_wall(
        "far wall", make_pose((end, width / 2, 0), yaw=-90), width, height, [pane], "stair window"
    )


def _flights(site: Site, lobby: float, end: float, width: float) -> None:
    """Up on the right, across the landing, back on the left."""
    across, middle, landing = width / 2 - 0.05, lobby + STEPS * RUN, STEPS * RISE
    flight = furniture.stair_flight(STEPS, across, RUN, RISE)
    site.add("lower flight", flight, make_pose((lobby, -width / 4, 0)))
    site.add("upper flight", flight, make_pose((middle, width / 4, landing), yaw=180))
    site.add("landing", box((middle, -width / 2, landing - 0.15), (end, width / 2, landing)), np.eye(4))
    rail = furniture.handrail((lobby, -0.06, 0), (middle, -0.06, landing))
    site.add("lower handrail", rail, np.eye(4))
    rail = furniture.handrail((lobby, 0.06, 2 * landing), (middle, 0.06, landing))
    site.add("upper handrail", rail, np.eye(4))


def _furnish(site: Site, lobby: float, width: float, rng: np.random.Generator) -> None:
    plant = furniture.plant(seed=int(rng.integers(2**31)))
    site.add("plant", plant, make_pose((lobby - 0.6, width / 2 - 0.45, 0)), movable=True)
    bench = make_pose((lobby - 1.6 + rng.uniform(-0.1, 0.1), width / 2 - 0.02, 0), yaw=-90)
    site.add("bench", furniture.bench(1.2), bench, movable=True)
    bin_place = make_pose((lobby - 0.35, -width / 2 + 0.25, 0))
    site.add("bin", furniture.waste_bin(), bin_place, movable=True)
    radiator = make_pose((lobby - 1.4, -width / 2 + 0.01, 0), yaw=90)
    site.add("radiator", furniture.radiator(), radiator)
    site.add(
        "extinguisher", cylinder(0.08, 0.5, sides=16), make_pose((1.2, -width / 2 + 0.1, 0.7)), movable=True
    )
    site.ceiling_lamps([(lobby / 2, 0.0)], 2 * STEPS * RISE - 0.2)
