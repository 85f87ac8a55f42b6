"""Ideal clouds: points drawn evenly from surfaces."""

import numpy as np
import pytest

from novelty.scan import CHANGED, UNCHANGED
from novelty.simulation import BodyState, Case, ExperimentPair, Setup, World, sample_pair
from novelty.simulation.sampling import sample_world
from novelty.simulation.shapes import box


def test_points_are_even_over_all_faces_whatever_their_size():
    world = World().add("box", box((0, 0, 0), (1, 2, 4)))
    samples = sample_world(world, 500, 0.0, np.random.default_rng(0))
    assert len(samples.points) == 500 * 2 * (2 + 4 + 8)
    for axis, extent, area in ((0, 1, 8), (1, 2, 4), (2, 4, 2)):
        for side in (0, extent):
            on_face = np.abs(samples.points[:, axis] - side) < 1e-12
            assert on_face.sum() == pytest.approx(500 * area, rel=0.1)
            others = np.delete(samples.points[on_face], axis, axis=1) / np.delete([1, 2, 4], axis)
            assert others.mean(axis=0) == pytest.approx([0.5, 0.5], abs=0.03)
            assert others.std(axis=0) == pytest.approx([12**-0.5] * 2, abs=0.02)


def test_noise_is_white_and_has_the_standard_deviation_asked_for():
    world = World().add("box", box((0, 0, 0), (1, 1, 1)))
    samples = sample_world(world, 2000, 0.02, np.random.default_rng(0))
    error = samples.points - samples.surface
    assert error.std(axis=0) == pytest.approx([0.02] * 3, rel=0.03)
    assert np.abs(np.corrcoef(error.T) - np.eye(3)).max() < 0.03


def test_the_synthetic_corridor_is_walls_a_ceiling_and_the_object():
    pair = sample_pair("ideal_corridor", 4, ("box",), density=100, noise=0.0, object_size=0.6)
    assert pair.reference.names == ("right wall", "left wall", "ceiling")
    assert pair.current.names == ("right wall", "left wall", "ceiling", "box 1")
    assert (pair.reference.labels == UNCHANGED).all()
    new = pair.current.objects == 3
    assert np.array_equal(pair.current.labels == CHANGED, new)
    assert (pair.current.states[new] == BodyState.ADDED).all()
    assert pair.current.observable.all()
    assert pair.scans.current.origin is None
    assert new.sum() == pytest.approx(100 * 0.6**2 * (2 * 1.15 * 0.9 + 2 * 1.15 + 2 * 0.9), abs=1)


def test_reverse_exchanges_the_worlds_and_seeds_repeat():
    options = {"changes": ("box",), "density": 50, "object_size": 0.6}
    gone = sample_pair("ideal_corridor", 4, reverse=True, **options)
    assert (gone.reference.labels == CHANGED).any()
    assert not (gone.current.labels == CHANGED).any()
    again = sample_pair("ideal_corridor", 4, reverse=True, **options)
    assert gone.scans.reference.points.tobytes() == again.scans.reference.points.tobytes()
    assert gone.scans.reference.points.tobytes() != gone.scans.current.points.tobytes()


@pytest.mark.parametrize(("keys", "noise"), [({}, 0.01), ({"noise": 0.0}, 0.0), ({"noise": 0.05}, 0.05)])
def test_an_experiment_of_samples_has_the_noise_asked_for(keys, noise):
    setup = Setup(scene="ideal_corridor", samples=100, **keys)
    scan = ExperimentPair("pair", Case("case", {}, setup), 0, 0).simulate().scans.reference
    ceiling = np.abs(scan.points[:, 2] - 3.2) < 0.3
    off_ceiling = scan.points[ceiling & (np.abs(scan.points[:, 1]) < 0.6), 2] - 3.2
    assert off_ceiling.std() == pytest.approx(noise, rel=0.1, abs=1e-12)
