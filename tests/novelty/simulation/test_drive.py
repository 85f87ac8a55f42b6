"""A robot that scans while it drives."""

import numpy as np
import pytest

from novelty.errors import InputError
from novelty.scan import CHANGED, UNCHANGED
from novelty.simulation import (
    RayScene,
    drive,
    find_truth,
    get_sensor,
    make_scene,
    measure,
    measure_drive,
    pair_up,
    simulate_pair,
)
from tests.novelty.simulation.worlds import ROOM


def test_a_drive_sweeps_the_room_line_by_line_from_its_own_origins():
    way, sensor = drive((-3.0, 0.5, 0.4), (3.0, 0.5, 0.4), spacing=0.05), get_sensor("lms_200").ideal()
    scan = measure_drive(RayScene(ROOM), sensor, way, np.random.default_rng(0))
    assert len(way.poses) == 121
    assert scan.surface[:, 0] == pytest.approx(scan.origins[:, 0], abs=1e-5)  # lines lie across the way
    assert (np.diff(scan.origins[:, 0]) >= 0).all()
    assert scan.surface[:, 2].min() > 0.4 - 1e-3
    assert (find_truth(scan, scan)[0].labels == UNCHANGED).all()


def test_drift_displaces_points_but_not_labels():
    rng, sensor, scene = np.random.default_rng, get_sensor("lms_200").ideal(), RayScene(ROOM)
    ways = [
        drive((-3, y, 0.4), (3, y, 0.4), drift=(0.01, 0.3), rng=rng(seed)) for seed, y in ((1, 0.0), (2, 0.1))
    ]
    scans = [measure_drive(scene, sensor, way, rng(0)) for way in ways]
    assert np.array_equal(scans[0].surface, measure(scene, sensor, ways[0].poses, rng(0)).surface)
    error = np.linalg.norm(scans[0].points - scans[0].surface, axis=1)
    assert error[scans[0].sweeps < 10].mean() < 0.5 * error[scans[0].sweeps > 100].mean()
    assert error.max() < 0.3
    pair = pair_up(*scans)
    assert pair.scans.reference.origin[-1] == pytest.approx(ways[0].believed[-1, :3, 3])
    assert not (pair.current.labels == CHANGED).any()


@pytest.mark.parametrize(("roll", "apart"), [(0.0, 0.0), (2.0, 2 * 1.5 * np.tan(np.radians(2.0)))])
def test_a_laser_mounted_askew_doubles_the_ceiling_of_a_drive_there_and_back(roll, apart):
    way = drive((-3, 0, 0.4), (3, 0, 0.4), (-3, 0, 0.4), mounting=(roll, 0.0))
    scan = measure_drive(RayScene(ROOM), get_sensor("lms_200").ideal(), way, np.random.default_rng(0))
    there = scan.sweeps < len(way.poses) // 2
    ceiling = (np.abs(scan.surface[:, 2] - 2.5) < 1e-3) & (np.abs(scan.surface[:, 1] - 1.5) < 0.1)
    heights = [scan.points[ceiling & side, 2].mean() for side in (there, ~there)]
    assert min(np.sum(ceiling & there), np.sum(ceiling & ~there)) > 100
    assert abs(heights[0] - heights[1]) == pytest.approx(apart, abs=0.005)
    if roll == 0:
        assert np.array_equal(scan.points, scan.surface)


def test_a_way_may_turn_corners():
    way = drive((0, 0, 0.4), (2, 0, 0.4), (2, 1, 0.4), spacing=0.5)
    assert way.poses[:, :2, 3].tolist() == [
        [0, 0],
        [0.5, 0],
        [1, 0],
        [1.5, 0],
        [2, 0],
        [2, 0],
        [2, 0.5],
        [2, 1],
    ]
    ahead = way.poses[:, :2, 0]
    assert np.allclose(ahead[:5], (1, 0))
    assert np.allclose(ahead[5:], (0, 1))


def test_a_scene_keeps_the_robots_path_free():
    for seed in range(4):
        pair = simulate_pair("hall", seed, ("person", "box", "cylinder"), sensor="lms_200", density=0.1)
        path = make_scene("hall", seed).path
        low, high = path.min(axis=0) - 0.25, path.max(axis=0) + 0.25  # a straight way there and back
        for name in set(pair.after.bodies) - set(pair.before.bodies):
            corners = pair.after.bodies[name].vertices[:, :2]
            apart = (corners.max(axis=0) < low) | (corners.min(axis=0) > high)
            assert apart.any()


def test_what_a_drive_needs_is_said():
    with pytest.raises(InputError, match="No path for a robot leads through the scene 'room'"):
        simulate_pair("room", sensor="lms_200")
    with pytest.raises(InputError, match="two different places"):
        drive((0, 0, 1), (1, 0, 1), (1, 0, 1))
