"""Pairs of simulated scans and their options."""

import time
from dataclasses import replace

import numpy as np
import pytest

from novelty.errors import InputError
from novelty.scan import CHANGED, SEEN_ONCE
from novelty.simulation import (
    BodyState,
    RayScene,
    compare_worlds,
    corridor_pair,
    demo_pair,
    get_sensor,
    make_scene,
    measure,
    simulate,
    simulate_pair,
)
from novelty.simulation.measure import as_poses
from tests.novelty.simulation.worlds import ROOM


def test_same_seed_same_bytes_and_other_seed_other_noise():
    one, same, other = (simulate(ROOM, "utm_30lx", (0, 0, 1), seed) for seed in (3, 3, 4))
    assert one.points.tobytes() == same.points.tobytes()
    assert one.points.tobytes() != other.points.tobytes()
    first, second, third = (corridor_pair(seed, density=0.2) for seed in (1, 1, 2))
    for scan in ("reference", "current"):
        assert getattr(first, scan).points.tobytes() == getattr(second, scan).points.tobytes()
        assert getattr(first, scan).labels.tobytes() == getattr(second, scan).labels.tobytes()
        assert getattr(first, scan).points.tobytes() != getattr(third, scan).points.tobytes()


def test_the_demonstration_is_as_described():
    pair = demo_pair()
    result = simulate_pair("corridor", 0, ("person", "box", "door"), noise=0.01)
    assert np.array_equal(pair.current.points, result.scans.current.points)
    states = compare_worlds(result.before, result.after)
    changed = {name: state for name, state in states.items() if state != BodyState.UNCHANGED}
    assert set(changed.values()) == {BodyState.ADDED, BodyState.MOVED}
    assert {name.split()[0] for name, state in changed.items() if state == BodyState.ADDED} == {
        "person",
        "box",
    }
    assert sum("door" in name for name, state in changed.items() if state == BodyState.MOVED) == 1
    for scan in (pair.reference, pair.current):
        assert scan.num_points >= 50_000
        assert scan.origin.shape == (3,)
        assert np.isfinite(scan.points).all()
        assert np.mean(np.abs(scan.points[:, 2]) < 0.03) > 0.1  # a floor, z up
    for name in changed:
        points = np.flatnonzero(result.current.objects == result.current.names.index(name))
        assert np.mean(result.current.labels[points] == CHANGED) > 0.9
        assert len(points) > 200


def test_options_of_a_pair():
    origins = ((1.5, 0.0, 1.0), (1.5, 0.0, 1.4))
    placed = corridor_pair(0, origins=origins, density=0.2)
    assert placed.reference.origin == pytest.approx(origins[0])
    assert placed.current.origin == pytest.approx(origins[1])
    shifted = corridor_pair(0, viewpoint_shift=0.5, density=0.2)
    assert np.linalg.norm(shifted.current.origin - shifted.reference.origin) == pytest.approx(0.5)
    small, large = (simulate_pair("room", 0, ("box",), object_size=size).after for size in (0.2, 0.6))
    assert np.ptp(small.bodies["box 1"].vertices[:, 2]) == pytest.approx(0.2)
    assert np.ptp(large.bodies["box 1"].vertices[:, 2]) == pytest.approx(0.6)


@pytest.mark.parametrize("seed", [2, 117])
def test_a_sensor_is_moved_to_where_nothing_stands(seed):
    """The first place that comes to mind is inside a cabinet."""
    pair = simulate_pair("corridor", seed, ("person",), viewpoint_shift=1.5, density=0.2)
    places = [scan.origin for scan in (pair.scans.reference, pair.scans.current)]
    assert np.linalg.norm(places[1] - places[0]) == pytest.approx(1.5)
    for world in (pair.before, pair.after):
        assert RayScene(world).crossings(places[0], places[1][None])[0] % 2 == 0
        assert RayScene(world).distance(places[1][None])[0] >= 0.15


def test_no_free_place_for_a_sensor_is_said():
    inside = replace(make_scene("corridor", 2), floor=np.array([[2.6, 1.0], [2.65, 1.05]]))  # of a cabinet
    with pytest.raises(InputError, match=r"no free place for the sensor 1\.5 m .* smaller viewpoint_shift"):
        simulate_pair(inside, viewpoint_shift=1.5)


def test_several_origins_make_one_scan_with_an_origin_per_point():
    stops = [(1.5, 0.0, 1.0), (6.0, 0.0, 1.0)]
    pair = corridor_pair(0, origins=(stops, stops[0]), density=0.2)
    assert pair.reference.origin.shape == (pair.reference.num_points, 3)
    assert {tuple(origin) for origin in pair.reference.origin} == set(stops)
    alone = corridor_pair(0, origins=(stops[1], stops[0]), density=0.2)
    hidden = [np.mean(scans.current.labels == SEEN_ONCE) for scans in (pair, alone)]
    assert hidden[0] < 0.02 < 0.1 < hidden[1]  # two stops see nearly all that one sees


def test_a_pose_error_moves_the_current_scan_rigidly():
    right, wrong = (corridor_pair(0, density=0.2, pose_error=error) for error in ((0.0, 0.0), (0.02, 0.5)))
    assert np.array_equal(right.reference.points, wrong.reference.points)
    assert np.array_equal(right.current.labels, wrong.current.labels)
    assert np.linalg.norm(wrong.current.origin - right.current.origin) == pytest.approx(0.02)
    one = right.current.points - right.current.origin
    other = wrong.current.points - wrong.current.origin
    assert np.linalg.norm(one, axis=1) == pytest.approx(np.linalg.norm(other, axis=1), abs=1e-9)
    turn = np.linalg.lstsq(one, other, rcond=None)[0]
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.slow
def test_speed():
    scene, sensor = RayScene(make_scene("corridor").world), get_sensor("utm_30lx").with_density(10)
    poses, rays = as_poses((1.5, 0.0, 1.0)), 541 * 1800

    def fastest(run, times=5):
        seconds = []
        for _ in range(times):
            start = time.process_time()
            run()
            seconds.append(time.process_time() - start)
        return min(seconds)

    assert rays / fastest(lambda: measure(scene, sensor, poses, np.random.default_rng(0))) > 2e6
    pair = corridor_pair(0, density=0.32)
    assert pair.reference.num_points + pair.current.num_points == pytest.approx(60_000, rel=0.1)
    assert fastest(lambda: corridor_pair(0, density=0.32)) < 1.0
