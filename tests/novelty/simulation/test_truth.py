"""Ground truth of a pair, from the two worlds."""

import numpy as np

from novelty.scan import AMBIGUOUS, CHANGED, SEEN_ONCE, UNCHANGED
from novelty.simulation import (
    BodyState,
    World,
    corridor_pair,
    find_truth,
    get_sensor,
    make_pose,
    make_scene,
    simulate_pair,
)
from novelty.simulation.shapes import box, sphere
from tests.novelty.simulation.worlds import CUBE, ROOM, scan_of


def labels_of(before, after, sensor="utm_30lx", poses=((0.0, 0.0, 1.0), (0.0, 0.0, 1.0))):
    ideal = get_sensor(sensor).ideal()
    scans = scan_of(before, ideal, poses[0]), scan_of(after, ideal, poses[1])
    return scans, find_truth(*scans)


def test_labels_of_an_added_object():
    (_, current), (before, after) = labels_of(ROOM, ROOM.add("cube", CUBE, (2, 0, 0)))
    cube = current.bodies == 1
    assert cube.sum() > 300
    on_floor = current.surface[:, 2] < 1e-3  # the lowest millimetre of the cube is where the floor was
    assert (after.labels[cube & ~on_floor] == CHANGED).all()
    assert (after.labels[~cube] == UNCHANGED).all()
    assert (after.states[cube] == BodyState.ADDED).all()
    assert (before.labels != CHANGED).all()


def test_points_hidden_by_the_new_object_are_seen_once_and_lie_in_its_shadow():
    (reference, _), (before, _) = labels_of(ROOM, ROOM.add("wall", box((2, -0.5, 0.5), (2.1, 0.5, 1.5))))
    # From (0, 0, 1) the slab at x = 2 covers |y| < x / 4 and |z - 1| < x / 4 beyond it.
    x, y, z = reference.surface.T
    shadow = (x > 2.1) & (np.abs(y) < 0.25 * x) & (np.abs(z - 1) < 0.25 * x)
    border = np.minimum(np.abs(np.abs(y) - 0.25 * x), np.abs(np.abs(z - 1) - 0.25 * x)) < 1e-3
    assert shadow.sum() > 100
    assert np.array_equal((before.labels == SEEN_ONCE)[~border], shadow[~border])


def test_removed_is_the_mirror_of_added():
    full = ROOM.add("cube", CUBE, (2, 0, 0))
    _, (before, after) = labels_of(ROOM, full)
    _, (mirrored_before, mirrored_after) = labels_of(full, ROOM)
    assert np.array_equal(before.labels, mirrored_after.labels)
    assert np.array_equal(after.labels, mirrored_before.labels)
    assert set(mirrored_before.states) == {BodyState.UNCHANGED, BodyState.REMOVED}


def test_where_a_moved_object_still_covers_its_old_place_nothing_changed():
    long = box((-1, -0.3, 0), (1, 0.3, 0.6))
    before = ROOM.add("slab", long, (0, 2, 0))
    (_, current), (_, after) = labels_of(before, before.move("slab", (0.5, 2, 0)))
    slab = np.flatnonzero(current.bodies == 1)
    x = current.surface[slab, 0]
    front = np.abs(current.surface[slab, 1] - 1.7) < 1e-4
    assert (after.states[slab] == BodyState.MOVED).all()
    assert (after.labels[slab[front & (x > 1.002)]] == CHANGED).all()
    assert (after.labels[slab[front & (x < 0.998)]] == UNCHANGED).all()
    assert np.sum(front & (x > 1.002)) > 50 < np.sum(front & (x < 0.998))


def test_a_moved_viewpoint_makes_seen_once_and_never_changed():
    world = ROOM.add("screen", box((0.9, -1.5, 0), (1.0, 1.5, 2.0)))
    (_, current), (_, after) = labels_of(
        world, world, poses=(make_pose((0, 0, 1)), make_pose((2, 0, 1), yaw=180))
    )
    back = np.abs(current.surface[:, 0] - 1.0) < 1e-4
    back &= (np.abs(current.surface[:, 1]) < 1.4) & (current.bodies == 1)
    assert set(np.unique(after.labels)) == {UNCHANGED, SEEN_ONCE}
    assert back.sum() > 100
    assert (after.labels[back] == SEEN_ONCE).all()


def test_a_new_object_out_of_the_other_sensors_sight_is_ambiguous():
    world = ROOM.add("screen", box((0.9, -1.5, 0), (1.0, 1.5, 2.0)))
    after_world = world.add("ball", sphere((1.6, 0, 0.8), 0.2))
    poses = (make_pose((0.0, 0.0, 1.0)), make_pose((3.0, 0.0, 1.0), yaw=180))
    (_, current), (_, after) = labels_of(world, after_world, poses=poses)
    ball = current.bodies == 2
    assert ball.sum() > 100
    assert (after.labels[ball] == AMBIGUOUS).all()
    assert not after.observable[ball].any()


def test_range_and_grazing_incidence_limit_what_was_observable():
    floor = World().add("floor", box((-40, -40, -0.1), (40, 40, 0)))
    sensor = get_sensor("utm_30lx").ideal()
    low, high = scan_of(floor, sensor, (0, 0, 0.5)), scan_of(floor, sensor, (0, 0, 5.0))
    _, truth = find_truth(low, high)
    distance = np.hypot(*high.surface[:, :2].T)
    ahead = high.surface[:, 0] > 0  # the cone behind the sensor is another matter
    limit = 0.5 * np.tan(
        np.radians(87)
    )  # 9.5 m: farther floor is met at more than 87 degrees from half a metre
    assert (truth.labels[distance > limit + 0.1] == SEEN_ONCE).all()
    assert (truth.labels[ahead & (distance < limit - 0.1)] == UNCHANGED).all()
    assert np.sum(ahead & (distance < limit - 0.1)) > 1000 < np.sum(distance > limit + 0.1)


def test_labels_do_not_depend_on_noise():
    options = {"changes": ("person", "box", "door"), "density": 0.3}
    quiet, loud = (simulate_pair("corridor", 5, noise=noise, **options) for noise in (0.001, 0.05))
    for one, other in ((quiet.reference, loud.reference), (quiet.current, loud.current)):
        assert np.array_equal(one.labels, other.labels)
        assert np.array_equal(one.objects, other.objects)


def test_mixed_pixels_and_glass_are_ambiguous():
    pair = simulate_pair("room", 0, ())
    glass = np.array(["glass" in name for name in pair.reference.names])[pair.reference.objects]
    assert glass.sum() > 10
    assert (pair.reference.labels[glass] == AMBIGUOUS).all()
    scan = scan_of(pair.before, pose=make_scene("room", 0).viewpoint)
    assert (find_truth(scan, scan)[0].labels[scan.mixed] == AMBIGUOUS).all()
    assert scan.mixed.any()


def test_the_same_world_measured_twice_has_no_change():
    pair = corridor_pair(4, changes=())
    for scan in (pair.reference, pair.current):
        assert set(np.unique(scan.labels)) <= {UNCHANGED, AMBIGUOUS}
    assert pair.reference.points[:100].tobytes() != pair.current.points[:100].tobytes()
