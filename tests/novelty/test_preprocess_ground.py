import numpy as np
import pytest

from novelty.preprocess import Preprocess
from novelty.preprocess.ground import NoGround, Plane, find_ground
from novelty.preprocess.spacing import spacing_of
from novelty.preprocess.survivors import Survivors
from novelty.scan import Scan

UP = np.array([0.0, 0.0, 1.0])


def _level(rng, count, height, low=(0, 0), high=(4, 3), noise=0.005):
    points = np.zeros((count, 3))
    points[:, :2] = rng.uniform(low, high, (count, 2))
    points[:, 2] = height + rng.normal(scale=noise, size=count)
    return points


def _wall(rng, count, height=2.5):
    points = rng.uniform([0, 0, 0], [4, 0, height], (count, 3))
    points[:, 1] = rng.normal(scale=0.005, size=count)
    return points


def _find(points, origin=None, **settings):
    scan = Survivors.from_scan(Scan(points, origin), 1.0)
    return find_ground(scan, Preprocess(**settings), spacing_of(scan.points))


def _rotated(points, degrees):
    angle = np.radians(degrees)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    return points @ turn.T


@pytest.fixture
def room(rng):
    return np.concatenate([_level(rng, 3000, 0.0), _wall(rng, 6000), _level(rng, 800, 0.75, (1, 1), (2, 2))])


def test_the_floor_of_a_room_is_found_though_a_wall_is_larger(room):
    plane = _find(room)
    assert isinstance(plane, Plane)
    held = plane.holds(room)
    assert held[:3000].mean() > 0.99
    assert held[3000:9000].mean() < 0.05
    assert not held[9000:].any()


def test_a_corridor_whose_ceiling_is_larger_than_its_floor(rng):
    points = np.concatenate([_level(rng, 1500, 0.0), _wall(rng, 4000), _level(rng, 6000, 2.5)])
    plane = _find(points)
    assert isinstance(plane, Plane)
    assert abs(plane.height) < 0.01
    assert not plane.holds(points[-6000:]).any()


def test_a_table_top_with_some_floor_beside_it_is_not_the_ground(rng):
    points = np.concatenate([_level(rng, 6000, 1.0), _level(rng, 600, 0.0), _wall(rng, 2000)])
    plane = _find(points)
    assert isinstance(plane, Plane)
    assert abs(plane.height) < 0.01


def test_a_table_top_above_scattered_points_is_not_the_ground(rng):
    below = rng.uniform([0, 0, 0], [4, 3, 0.9], (500, 3))
    found = _find(np.concatenate([_level(rng, 6000, 1.0), below]))
    assert isinstance(found, NoGround)
    assert "below" in found.reason


def test_walls_alone_have_no_ground(rng):
    wall = _wall(rng, 6000)
    found = _find(np.concatenate([wall, wall[:, [1, 0, 2]]]))
    assert isinstance(found, NoGround)


def test_an_optical_frame_with_its_wall_ahead_has_no_ground(rng):
    ahead = np.concatenate(
        [_level(rng, 6000, 1.5, (-1, -1), (1, 1)), _level(rng, 900, 0.9, (0, 0), (0.3, 0.3))]
    )
    assert isinstance(_find(ahead), NoGround)
    only = _find(ahead[:6000], origin=(0, 0, 0))
    assert isinstance(only, NoGround)
    assert "above the sensor" in only.reason


def test_a_table_seen_at_45_degrees_is_too_steep_for_a_ground(rng):
    found = _find(_rotated(_level(rng, 6000, 1.0), 45))
    assert isinstance(found, NoGround)


@pytest.mark.parametrize("degrees", [0, 10])
def test_a_ground_may_be_tilted_and_up_may_point_anywhere(room, degrees):
    tilted = _rotated(room, degrees)[:, [1, 2, 0]] + np.array([5e5, 4e6, 100])
    plane = _find(tilted, up=(0, 2, 0))
    assert isinstance(plane, Plane)
    assert plane.holds(tilted)[:3000].mean() > 0.99


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.03])
def test_the_tolerance_follows_the_noise_of_the_scan(rng, noise):
    points = np.concatenate([_level(rng, 8000, 0.0, noise=noise), _wall(rng, 4000)])
    plane = _find(points)
    assert isinstance(plane, Plane)
    assert plane.holds(points[:8000]).mean() > 0.97
    assert plane.tolerance < max(4 * noise, 0.1)


def test_a_given_distance_is_used_as_it_is(room):
    plane = _find(room, ground_distance=0.02)
    assert isinstance(plane, Plane)
    assert plane.tolerance == 0.02


def test_the_same_seed_gives_the_same_plane_and_another_seed_nearly_the_same(room):
    first, again, other = _find(room, seed=1), _find(room, seed=1), _find(room, seed=2)
    assert np.array_equal(first.normal, again.normal)
    assert first.height == again.height
    assert np.mean(first.holds(room) != other.holds(room)) < 0.01


@pytest.mark.parametrize("count", [1, 2, 3, 4, 20])
def test_few_points_do_not_break_the_search(rng, count):
    _find(rng.normal(size=(count, 3)))
    assert isinstance(_find(np.zeros((count, 3))), NoGround)
    assert isinstance(_find(np.outer(np.arange(count), [1.0, 0, 0])), NoGround)
