"""Ideal point clouds: points drawn evenly from all surfaces, without a sensor, a viewpoint or anything hidden."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.simulation.poses import FloatArray, transform
from novelty.simulation.world import World


@dataclass(frozen=True, eq=False)
class Samples:
    """Points drawn from the surfaces of a world.

    Attributes:
        world: The world.
        surface: (N, 3), m, without noise; object after object.
        points: (N, 3), m, with noise.
        bodies: int32 (N,), the object that each point is on, by its place in the world.
    """

    world: World
    surface: FloatArray
    points: FloatArray
    bodies: NDArray[np.int32]


def sample_world(world: World, density: float, noise: float, rng: np.random.Generator) -> Samples:
    """Draw `density` points per square metre, displaced by white noise of standard deviation `noise`, m, per axis."""
    bodies = tuple(world.bodies.values())
    counts = [round(density * body.mesh.areas.sum()) for body in bodies]
    surface = np.concatenate(
        [
            transform(body.pose, body.mesh.sample(count, rng))
            for body, count in zip(bodies, counts, strict=True)
        ]
    )
    points = surface + noise * rng.standard_normal(surface.shape)
    return Samples(world, surface, points, np.repeat(np.arange(len(bodies), dtype=np.int32), counts))
