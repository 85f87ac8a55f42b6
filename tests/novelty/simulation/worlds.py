"""What the tests of the simulator scan: an empty room, and a cube to put into it."""

import numpy as np

from novelty.simulation import RayScene, World, get_sensor, measure
from novelty.simulation.measure import as_poses
from novelty.simulation.shapes import block, box

ROOM = World().add("room", box((-4, -3, 0), (4, 3, 2.5)))
CUBE = block(0.6, 0.6, 0.6)


def scan_of(world, sensor="utm_30lx", pose=(0.0, 0.0, 1.0), seed=0):
    return measure(RayScene(world), get_sensor(sensor), as_poses(pose), np.random.default_rng(seed))
