"""A simulated pair of scans and everything that is known about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from novelty.scan import CHANGED, UNCHANGED, Scan, ScanPair
from novelty.simulation.measure import Measurement
from novelty.simulation.raycast import RayScene
from novelty.simulation.sampling import Samples
from novelty.simulation.truth import Truth, find_truth, is_new_surface, states_of
from novelty.simulation.world import BodyState, World, compare_worlds


@dataclass(frozen=True, eq=False)
class SimulatedPair:
    """A pair of scans with everything that is known about it.

    Attributes:
        scans: What a detector is given, with labels.
        before: The world of the reference scan.
        after: The world of the current scan.
        reference: Truth of the reference scan's points.
        current: Truth of the current scan's points.
        measurements: What was measured in the reference and in the current scan; None for points that were sampled.
    """

    scans: ScanPair
    before: World
    after: World
    reference: Truth
    current: Truth
    measurements: tuple[Measurement, Measurement] | None = None


def pair_up(reference: Measurement, current: Measurement, name: str = "") -> SimulatedPair:
    """Two measurements, of the world before and of the world after, as a labelled pair."""
    truth = find_truth(reference, current)
    scans = ScanPair(
        reference.scan(truth[0].labels, f"{name} reference"),
        current.scan(truth[1].labels, f"{name} current"),
        name,
    )
    return SimulatedPair(scans, reference.scene.world, current.scene.world, *truth, (reference, current))


def pair_samples(reference: Samples, current: Samples, name: str = "") -> SimulatedPair:
    """Samples of the world before and of the world after as a labelled pair; everything is seen in both."""
    states = compare_worlds(reference.world, current.world)
    truth = _judge(reference, current, states), _judge(current, reference, states)
    scans = ScanPair(
        Scan(reference.points, labels=truth[0].labels, name=f"{name} reference"),
        Scan(current.points, labels=truth[1].labels, name=f"{name} current"),
        name,
    )
    return SimulatedPair(scans, reference.world, current.world, *truth)


def _judge(own: Samples, other: Samples, states: dict[str, BodyState]) -> Truth:
    names = tuple(own.world.bodies)
    state = states_of(names, states)[own.bodies]
    changed = is_new_surface(own.surface, state, RayScene(other.world))
    labels = np.where(changed, CHANGED, UNCHANGED).astype(np.uint8)
    return Truth(labels, own.bodies, names, state, np.ones(len(labels), dtype=np.bool_))
