"""Exact ground truth of a simulated scan, from the two worlds and not from distances between points.

Every point is judged by the surface point x that its ray hit, without noise, and by the object it belongs to:

* `AMBIGUOUS` (255): the reading is a mixed pixel, or comes from glass (an object that returns less than half of
  the rays); or it would be `CHANGED`, but the other sensor could not see x, so that no comparison can tell.
* `CHANGED` (1): the object is absent from the other world or stood elsewhere in it, no surface of the other world
  passes through x, and the other sensor could see x.
* `SEEN_ONCE` (2): the surface at x existed in both worlds, but the other sensor could not see x: it is out of its
  field of view or range, met at too grazing an angle, or hidden behind something in the other world.
* `UNCHANGED` (0): the surface existed in both worlds and the other sensor could see it.

The rule is symmetric: for a reference point, `CHANGED` means removed or moved away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.scan import AMBIGUOUS, CHANGED, SEEN_ONCE, UNCHANGED
from novelty.simulation.measure import Measurement
from novelty.simulation.poses import FloatArray, inverse, transform
from novelty.simulation.raycast import RayScene
from novelty.simulation.world import BodyState, compare_worlds

SAME_PLACE = 1e-3
"""A surface passes through a point when it is nearer than this, m: above rounding, below any noise."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known about each of the N points of a scan.

    Attributes:
        labels: uint8 (N,), the values of `Scan.labels`.
        objects: int32 (N,), the object that was hit, a position in `names`.
        names: The objects of the scanned world.
        states: uint8 (N,), `BodyState` of that object between the two worlds.
        observable: bool (N,), whether the other sensor could see the place of the point.
    """

    labels: NDArray[np.uint8]
    objects: NDArray[np.int32]
    names: tuple[str, ...]
    states: NDArray[np.uint8]
    observable: NDArray[np.bool_]


def find_truth(reference: Measurement, current: Measurement) -> tuple[Truth, Truth]:
    """Ground truth of both scans of a pair."""
    states = compare_worlds(reference.scene.world, current.scene.world)
    return _judge(reference, current, states), _judge(current, reference, states)


def _judge(own: Measurement, other: Measurement, states: dict[str, BodyState]) -> Truth:
    state = states_of(own.scene.names, states)[own.bodies]
    changed = is_new_surface(own.surface, state, other.scene)
    observable = can_see(other, own.surface)
    labels = np.where(observable, UNCHANGED, SEEN_ONCE).astype(np.uint8)
    labels[changed] = np.where(observable[changed], CHANGED, AMBIGUOUS)
    labels[own.mixed | (own.scene.reflectivity[own.bodies] < 0.5)] = AMBIGUOUS
    return Truth(labels, own.bodies, own.scene.names, state, observable)


def states_of(names: tuple[str, ...], states: dict[str, BodyState]) -> NDArray[np.uint8]:
    """`BodyState` of every object of a world, (objects,)."""
    return np.array([states[name] for name in names], dtype=np.uint8)


def is_new_surface(surface: FloatArray, states: NDArray[np.uint8], other: RayScene) -> NDArray[np.bool_]:
    """Whether each point (N, 3) of an object that was added, removed or moved is on no surface of the other world."""
    changed = states != BodyState.UNCHANGED
    rows = np.flatnonzero(changed)
    changed[rows] = other.distance(surface[rows]) > SAME_PLACE
    return changed


def can_see(measurement: Measurement, points: FloatArray) -> NDArray[np.bool_]:
    """Whether the sensor of a measurement could see each of `points` (N, 3) from any of its poses: (N,)."""
    seen = np.zeros(len(points), dtype=np.bool_)
    for pose in measurement.poses:
        rows = np.flatnonzero(~seen)
        seen[rows] = _sees_from(measurement, pose, points[rows])
    return seen


def _sees_from(measurement: Measurement, pose: FloatArray, points: FloatArray) -> NDArray[np.bool_]:
    scene, sensor, origin = measurement.scene, measurement.sensor, pose[:3, 3]
    local = transform(inverse(pose), points)
    distance = np.linalg.norm(local, axis=1)
    seen = sensor.pattern.covers(local) & (distance >= sensor.min_range) & (distance <= sensor.max_range)
    rows = np.flatnonzero(seen)
    seen[rows] = scene.sees(origin, points[rows], min_cosine=sensor.min_cosine)
    if sensor.emitter is not None:
        rows = np.flatnonzero(seen)
        seen[rows] = scene.sees(transform(pose, sensor.emitter), points[rows])
    return seen
