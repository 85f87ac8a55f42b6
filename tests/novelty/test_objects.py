"""Objects: their boxes, numbers, neighbours and p-values, and which of them were moved."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from novelty import PointState, detect
from novelty.objects import OrientedBox, Things, describe_objects, find_moves, number_objects
from novelty.objects.rigid import overlay
from novelty.report import headline
from novelty.report.tables import object_table
from novelty.result import ComponentRecord
from novelty.simulation import simulate_pair

UP = (0.0, 0.0, 1.0)


def carton(rng, edges, faces, count=400, noise=0.003):
    """Points on some faces (axis, side) of a box round zero."""
    parts = []
    for axis, side in faces:
        points = rng.uniform(-0.5, 0.5, (count, 3))
        points[:, axis] = side / 2
        parts.append(points * edges)
    points = np.concatenate(parts)
    return points + rng.normal(0, noise, points.shape)


def off_axes(box, rotation):
    """Greatest angle between the axes of a box and the true ones, degrees."""
    best = np.abs(rotation.T @ box.rotation).max(axis=0)
    return np.degrees(np.arccos(np.clip(best, -1, 1))).max()


@pytest.mark.parametrize("faces", [((0, 1), (1, 1)), ((0, 1), (1, 1), (2, 1)), ((0, -1), (2, 1))])
def test_box_of_a_carton_seen_from_one_side_lies_along_its_sides(rng, faces):
    rotation = Rotation.from_euler("zyx", [33, 12, 5], degrees=True).as_matrix()
    box = OrientedBox.around(carton(rng, (0.6, 0.4, 0.5), faces) @ rotation.T + (4, 5, 6))
    assert off_axes(box, rotation) < 3


def test_box_knows_centre_and_extent(rng):
    turned = Rotation.from_euler("z", 20, degrees=True).as_matrix()
    faces = [(axis, side) for axis in range(3) for side in (-1, 1)]
    box = OrientedBox.around(carton(rng, (0.4, 0.9, 0.6), faces, 200) @ turned.T + (1e5, 2, 3))
    np.testing.assert_allclose(box.extent, (0.9, 0.6, 0.4), atol=0.04)
    np.testing.assert_allclose(box.center, (1e5, 2, 3), atol=0.02)
    np.testing.assert_allclose(box.rotation.T @ box.rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(box.rotation) == pytest.approx(1)


def test_a_few_strays_do_not_stretch_the_box(rng):
    points = carton(rng, (0.6, 0.4, 0.5), ((0, 1), (1, 1)))
    strays = rng.uniform(2, 4, (5, 3))
    with_strays = OrientedBox.around(np.concatenate([points, strays]))
    np.testing.assert_allclose(with_strays.extent, OrientedBox.around(points).extent, atol=0.03)


@pytest.mark.parametrize(
    ("points", "extent"),
    [
        ([[1.0, 2, 3]], (0, 0, 0)),
        ([[0.0, 0, 0], [0, 2, 0], [0, 1, 0]], (2, 0, 0)),
        ([[0.0, 0, 0], [3, 0, 0], [3, 1, 0], [0, 1, 0]], (3, 1, 0)),
    ],
)
def test_box_of_points_without_a_body(points, extent):
    np.testing.assert_allclose(OrientedBox.around(np.array(points)).extent, extent, atol=1e-9)


def test_objects_are_numbered_by_size():
    groups = np.array([0, -1, 1, 1, 2, 2, 2])
    assert number_objects(groups).tolist() == [2, -1, 1, 1, 0, 0, 0]
    assert number_objects(np.full(3, -1)).tolist() == [-1, -1, -1]


def described(overlap=0.0, p_values=(0.01, 0.6, np.nan), components=True):
    """Three objects on a line; component k is object k's own, and component 0 also has a point of object 1."""
    points = np.repeat(np.arange(12.0)[:, None], 3, axis=1)
    objects = np.repeat([0, 1, 2], 4)
    owner = objects.copy() if components else np.full(12, -1)
    records = [
        ComponentRecord(k, 0.3, np.zeros(3), np.eye(3), 4, True, float(k), np.nan, -1, np.nan, "")
        for k in range(3)
    ]
    overlaps = np.eye(3)
    overlaps[0, 1] = overlaps[1, 0] = overlap
    scores = np.arange(12.0)
    of_points = np.repeat(p_values, 4)
    known = records if components else []
    return describe_objects(points, objects, owner, scores, of_points, known, overlaps, "added")


def test_neighbours_share_responsibilities():
    assert [record.neighbours for record in described(overlap=0.2)] == [(1,), (0,), ()]
    assert [record.neighbours for record in described(overlap=0.0)] == [(), (), ()]


def test_p_value_of_an_object_is_twice_the_median_of_its_points():
    assert [record.p_value for record in described()[:2]] == [0.02, 1.0]
    assert np.isnan(described()[2].p_value)


def test_an_object_without_components_has_the_median_score_of_its_points():
    assert [record.score for record in described(components=False)] == [1.5, 5.5, 9.5]


def turned_and_shifted(degrees, shift):
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    motion[:3, 3] = shift
    return motion


def wedge(rng, height, count=900):
    """An L of two different boxes: a shape without symmetry."""
    faces = [(axis, side) for axis in range(3) for side in (-1, 1)]
    low = carton(rng, (0.8, 0.3, 0.2), faces, count // 12)
    tall = carton(rng, (0.2, 0.3, height), faces, count // 12) + np.array([0.3, 0.0, height / 2])
    return np.concatenate([low, tall])


def test_a_moved_object_is_found_with_its_motion(rng):
    motion = turned_and_shifted(130, (2.0, -1.0, 0.0))
    before, after = wedge(rng, 0.7), wedge(rng, 0.7) @ motion[:3, :3].T + motion[:3, 3]
    (move,) = find_moves(Things((before,), ()), Things((after,), ()), 0.01, UP)
    assert (move.removed, move.added) == (0, 0)
    np.testing.assert_allclose(move.motion, motion, atol=0.05)


def test_a_symmetric_thing_is_said_to_turn_as_little_as_explains_it(rng):
    faces = [(axis, side) for axis in range(3) for side in (-1, 1)]
    before = carton(rng, (0.9, 0.3, 0.5), faces, 150)
    motion = turned_and_shifted(170, (2.0, -1.0, 0.0))
    after = carton(rng, (0.9, 0.3, 0.5), faces, 150) @ motion[:3, :3].T + motion[:3, 3]
    (move,) = find_moves(Things((before,), ()), Things((after,), ()), 0.01, UP)
    assert np.degrees(Rotation.from_matrix(move.motion[:3, :3]).magnitude()) < 15


def test_objects_of_other_shape_are_not_moved(rng):
    faces = [(axis, side) for axis in range(3) for side in (-1, 1)]
    before, after = wedge(rng, 0.7), carton(rng, (0.9, 0.4, 0.4), faces, 150) + np.array([2.0, 0, 0])
    assert find_moves(Things((before,), ()), Things((after,), ()), 0.01, UP) == []


def test_each_object_has_one_partner(rng):
    before, copy = wedge(rng, 0.7), wedge(rng, 0.7)
    twins = tuple(copy + np.array([x, 0.0, 0.0]) for x in (2, 5))
    moves = find_moves(Things((before,), ()), Things(twins, ()), 0.01, UP)
    assert len(moves) == 1


def test_what_the_other_scan_saw_to_be_empty_speaks_against_a_move(rng):
    from novelty.visibility import Rays

    # Only one face is left of the box; where the others would be, the sensor saw the wall behind.
    faces = [(axis, side) for axis in range(3) for side in (-1, 1)]
    before, after = carton(rng, (0.6, 0.5, 0.7), faces, 200), carton(rng, (0.6, 0.5, 0.7), ((1, -1),), 600)
    grid = np.stack(np.meshgrid(np.linspace(-3, 3, 150), [3.0], np.linspace(-2, 2, 150)), -1).reshape(-1, 3)
    seen_through = Rays.of(np.concatenate([grid, after]), np.array([4.0, -4.0, 0.0]))
    hidden = Rays.of(after, np.array([0.0, -4.0, 0.0]))

    def agreed(rays):
        return len(find_moves(Things((before,), ()), Things((after,), (rays,)), 0.01, UP))

    assert agreed(seen_through) == 0
    assert agreed(hidden) <= 1


def test_an_end_of_a_thing_is_recognised_where_something_hid_the_rest(rng):
    from novelty.visibility import Rays

    knob = rng.normal((-0.65, 0.0, 0.35), 0.05, (150, 3))
    whole = np.concatenate([carton(rng, (1.5, 0.3, 0.2), ((1, -1), (2, 1), (0, -1))), knob])
    end, motion = whole[whole[:, 0] < 0.0], turned_and_shifted(100, (2.0, 1.0, 0.0))
    assert len(end) > 100
    after = whole @ motion[:3, :3].T + motion[:3, 3]
    sensor = np.array([0.0, -4.0, 1.0])
    x, z = np.meshgrid(np.linspace(-0.05, 0.8, 80), np.linspace(0.2, 0.8, 80))
    screen = np.stack([x.ravel(), np.full(x.size, -2.0), z.ravel()], axis=-1)
    wall = np.stack(np.meshgrid(np.linspace(-4, 4, 200), [3.0], np.linspace(-3, 2, 150)), -1).reshape(-1, 3)
    before = Rays.of(np.concatenate([end, screen, wall]), sensor)
    (move,) = find_moves(Things((end,), (before,)), Things((after,), (Rays.of(after, sensor),)), 0.01, UP)
    np.testing.assert_allclose(move.motion, motion, atol=0.05)
    without_screen = Rays.of(np.concatenate([end, wall]), sensor)
    assert not find_moves(Things((end,), (without_screen,)), Things((after,), ()), 0.01, UP)


@pytest.fixture(scope="module")
def moved_bin():
    simulated = simulate_pair("corridor", 3, ("move",), noise=0.01, density=0.3)
    return simulated, detect(simulated.scans)


def test_moved_object_through_the_pipeline(moved_bin):
    simulated, result = moved_bin
    (added,), (removed,) = (
        [record for record in change.objects if record.kind == "moved"]
        for change in (result.added, result.removed)
    )
    assert (added.counterpart, removed.counterpart) == (removed.index, added.index)
    for change, record in ((result.added, added), (result.removed, removed)):
        own = change.point_objects == record.index
        assert (change.point_states[own] == PointState.MOVED).all()
        assert change.point_labels[own].all()
    before, after = (world.bodies["bin"].pose for world in (simulated.before, simulated.after))
    np.testing.assert_allclose(
        (added.motion @ np.append(removed.centroid, 1))[:2] - removed.centroid[:2],
        (after[:3, 3] - before[:3, 3])[:2],
        atol=0.2,  # a bin is round: its turn is not seen
    )


def test_moved_object_in_words(moved_bin):
    _, result = moved_bin
    assert headline(result) == "Changed: 1 object moved"
    table = object_table(result, "m")
    assert [column.name for column in table.columns][3] == "moved by [m]"
    assert [row.mark for row in table.rows] == ["moved"]


def test_removed_and_added_things_of_other_shape_stay_apart():
    result = detect(simulate_pair("corridor", 1, ("remove", "box"), noise=0.01, density=0.3).scans)
    assert {record.kind for record in (*result.added.objects, *result.removed.objects)} <= {
        "added",
        "removed",
    }
    assert result.added.objects


def test_overlays_are_as_good_on_a_map_as_at_its_origin(rng):
    shape = torch.from_numpy(carton(rng, (0.6, 0.4, 0.5), ((0, 1), (1, 1), (2, 1)), 60))
    start = torch.eye(3, dtype=torch.float64)[None], torch.zeros(1, 3, dtype=torch.float64)
    far = torch.tensor([5e5, 5e6, 100.0], dtype=torch.float64)
    here, there = (overlay(shape + at, shape + at, *start, reach=0.1, steps=3) for at in (0.0, far))
    assert here.gaps.max() < 1e-6
    assert there.gaps.max() < 1e-6
