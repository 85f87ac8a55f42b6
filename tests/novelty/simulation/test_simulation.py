"""Worlds, scans of them, and their ground truth."""

import json
import struct
import time

import numpy as np
import pytest

from novelty.errors import InputError
from novelty.scan import AMBIGUOUS, CHANGED, SEEN_ONCE, UNCHANGED
from novelty.simulation import (
    CHANGES,
    SCENES,
    SENSORS,
    BodyState,
    Mesh,
    RayScene,
    World,
    apply_changes,
    compare_worlds,
    corridor_pair,
    demo_pair,
    drive,
    find_truth,
    get_sensor,
    load_mesh,
    make_pose,
    make_scene,
    measure,
    measure_drive,
    pair_up,
    simulate,
    simulate_pair,
)
from novelty.simulation.measure import as_poses
from novelty.simulation.shapes import block, box, cylinder, sphere

ROOM = World().add("room", box((-4, -3, 0), (4, 3, 2.5)))
CUBE = block(0.6, 0.6, 0.6)
BUILDINGS = sorted(set(SCENES) - {"ideal_corridor", "relief"})


def scan_of(world, sensor="utm_30lx", pose=(0.0, 0.0, 1.0), seed=0):
    return measure(RayScene(world), get_sensor(sensor), as_poses(pose), np.random.default_rng(seed))


def labels_of(before, after, sensor="utm_30lx", poses=((0.0, 0.0, 1.0), (0.0, 0.0, 1.0))):
    ideal = get_sensor(sensor).ideal()
    scans = scan_of(before, ideal, poses[0]), scan_of(after, ideal, poses[1])
    return scans, find_truth(*scans)


def test_a_world_is_never_changed_in_place():
    more = ROOM.add("cube", CUBE)
    moved = more.move("cube", (1.0, 0.0, 0.0))
    assert list(ROOM.bodies) == ["room"]
    assert np.array_equal(more.bodies["cube"].pose, np.eye(4))
    assert list(moved.remove("cube").bodies) == ["room"]


def test_worlds_are_compared_by_name_and_surface():
    before = ROOM.add("kept", CUBE, (1, 1, 0)).add("shifted", CUBE, (2, 0, 0)).add("gone", CUBE, (-2, 0, 0))
    after = before.remove("gone").move("shifted", (2, 0.01, 0)).add("new", CUBE, (0, -2, 0))
    assert compare_worlds(before, after) == {
        "room": BodyState.UNCHANGED,
        "kept": BodyState.UNCHANGED,
        "shifted": BodyState.MOVED,
        "gone": BodyState.REMOVED,
        "new": BodyState.ADDED,
    }


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda: ROOM.add("room", CUBE), "already has an object 'room'"),
        (lambda: ROOM.remove("cube"), "no object 'cube'; it has room"),
        (lambda: ROOM.move("room", np.diag([2.0, 1, 1, 1])), "not a rotation"),
        (lambda: ROOM.add("cube", CUBE, np.zeros((3, 3))), r"got shape \(3, 3\)"),
        (lambda: Mesh([[0, 0, 0]], [[0, 1, 2]]), "name existing vertices"),
        (lambda: Mesh([[0, 0, 0]], np.empty((0, 3))), "at least one triangle"),
        (lambda: load_mesh("no-such.obj"), "no such mesh file"),
        (lambda: simulate(World(), "utm_30lx", (0, 0, 1)), "world is empty"),
        (lambda: simulate(ROOM, "utm", (0, 0, 1)), "no sensor 'utm'"),
        (lambda: make_scene("garden"), "no scene 'garden'"),
        (lambda: corridor_pair(changes=["fire"]), "no change 'fire'"),
        (lambda: simulate_pair("room", sensor="lms_200"), "No path for a robot leads through .* .room."),
        (lambda: drive((0, 0, 1), (0, 0, 1)), "two different places"),
        (lambda: drive((0, 0, 1), (1, 0, 1), drift=(0.01, 0.1)), "needs a generator"),
        (lambda: get_sensor("kinect").with_noise(0.01), "no constant range noise"),
    ],
)
def test_what_cannot_be_done_is_said(use, message):
    with pytest.raises(InputError, match=message):
        use()


def write_mesh(path, vertices, triangles):
    import open3d as o3d

    if path.suffix == ".glb":  # by hand: what Open3D 0.20 writes, it cannot read
        return path.write_bytes(glb(vertices.astype("<f4"), triangles.astype("<u4")))
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(vertices.copy()), o3d.utility.Vector3iVector(triangles.copy())
    )
    return o3d.io.write_triangle_mesh(str(path), mesh)


def glb(vertices, triangles):
    """A binary glTF 2.0 file with one mesh."""
    parts = [vertices.tobytes(), triangles.tobytes()]
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    offsets = [0, len(parts[0])]
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": len(vertices),
                "type": "VEC3",
                "min": low,
                "max": high,
            },
            {"bufferView": 1, "componentType": 5125, "count": triangles.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": offset, "byteLength": len(part)}
            for offset, part in zip(offsets, parts, strict=True)
        ],
        "buffers": [{"byteLength": len(parts[0]) + len(parts[1])}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(parts)
    total = 12 + 8 + len(text) + 8 + len(body)
    head = struct.pack("<4sII", b"glTF", 2, total)
    return (
        head
        + struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", len(body), b"BIN\0")
        + body
    )


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb"])
def test_own_meshes_can_be_scanned(tmp_path, suffix):
    path = tmp_path / f"mesh.{suffix}"
    mesh = box((0, 0, 0), (1000, 2000, 500))
    write_mesh(path, mesh.vertices, mesh.triangles)
    world = World().add("machine", load_mesh(path, scale=0.001), (2.0, -1.0, 0.0))
    points = simulate(world, get_sensor("utm_30lx").ideal(), (0.0, 0.0, 0.25)).points
    low, high = world.bodies["machine"].vertices.min(axis=0), world.bodies["machine"].vertices.max(axis=0)
    assert np.sort(high - low) == pytest.approx([0.5, 1.0, 2.0])
    assert len(points) > 100
    assert ((points > low - 1e-4) & (points < high + 1e-4)).all()


@pytest.mark.parametrize("name", SENSORS)
def test_noiseless_points_lie_on_the_surface_that_was_hit(name):
    pose = make_pose((500_000.2, -40.0, 7.0), yaw=30)
    world = World().add("room", box((-4, -3, 0), (4, 3, 2.5)), make_pose((500_000, -40, 6), yaw=12))
    scan = scan_of(world, get_sensor(name).with_density(0.2).ideal(), pose)
    local = (scan.points - world.bodies["room"].pose[:3, 3]) @ world.bodies["room"].pose[:3, :3]
    off_wall = np.min(np.abs(np.concatenate([local - (-4, -3, 0), local - (4, 3, 2.5)], axis=1)), axis=1)
    assert len(scan.points) > 300
    assert off_wall.max() < 1e-4
    assert np.array_equal(scan.points, scan.surface)


@pytest.mark.parametrize("name", SENSORS)
def test_every_ray_is_inside_the_field_of_view(name):
    pattern = get_sensor(name).pattern
    rays = pattern.directions().reshape(-1, 3).astype(np.float64)
    assert np.linalg.norm(rays, axis=1) == pytest.approx(1, abs=1e-6)
    assert pattern.covers(3.0 * rays).all()


@pytest.mark.parametrize("name", sorted(set(SENSORS) - {"lms_200"}))
def test_density_changes_the_number_of_rays(name):
    rays, fewer = (get_sensor(name).with_density(density).pattern.directions() for density in (1.0, 0.25))
    assert fewer[..., 0].size == pytest.approx(rays[..., 0].size / 4, rel=0.05)
    assert get_sensor("lms_200").with_density(0.25).pattern.spacing == 0.2


def test_the_field_of_view_has_an_outside():
    behind, above = np.array([[-1.0, 0.0, 0.0]]), np.array([[0.3, 0.0, 1.0]])
    assert not get_sensor("utm_30lx").pattern.covers(behind)[0]
    assert not get_sensor("urg_04lx").pattern.covers(above)[0]
    assert not get_sensor("vlp_16").pattern.covers(above)[0]
    assert not get_sensor("kinect").pattern.covers(behind)[0]


@pytest.mark.parametrize(("name", "std"), [("utm_30lx", 0.01), ("vlp_16", 0.03), ("urg_04lx", 0.02)])
def test_range_noise_has_the_standard_deviation_asked_for(name, std):
    scan = scan_of(ROOM, get_sensor(name).with_noise(std))
    error = np.linalg.norm(scan.points - scan.origins, axis=1) - np.linalg.norm(
        scan.surface - scan.origins, axis=1
    )
    assert error[~scan.mixed].std() == pytest.approx(std, rel=0.03)
    assert abs(error[~scan.mixed].mean()) < 0.03 * std


def test_relative_noise_grows_with_range():
    far, near = (
        scan_of(World().add("shell", sphere((0, 0, 0), radius)), "urg_04lx", (0, 0, 0))
        for radius in (5.0, 1.0)
    )
    spread = [np.std(np.linalg.norm(scan.points - scan.surface, axis=1)) for scan in (far, near)]
    assert spread[0] > 3 * spread[1]


def test_depth_camera_quantises_disparity_and_error_grows_with_the_square():
    wall, camera = box((2.0, -5, -5), (2.1, 5, 5)), get_sensor("kinect").with_density(0.1)
    scans = [scan_of(World().add("wall", wall, (shift, 0, 0)), camera, (0, 0, 0)) for shift in (0.0, 2.0)]
    disparity = 586 * 0.075 / scans[0].points[:, 0] * 8
    assert disparity == pytest.approx(np.rint(disparity), abs=1e-3)
    spread = [np.std(scan.points[:, 0] - scan.surface[:, 0]) for scan in scans]
    assert spread[1] / spread[0] == pytest.approx(4, rel=0.15)
    assert spread[0] == pytest.approx(1.425e-3 * 4, rel=0.25)  # sigma of eq. 10; rounding adds a little


def test_depth_camera_has_shadows_on_one_side():
    world = (
        World().add("wall", box((3, -3, -3), (3.1, 3, 3))).add("post", box((1.5, -0.05, -3), (1.6, 0.05, 3)))
    )
    scan = scan_of(world, get_sensor("kinect").with_density(0.2).ideal(), (0, 0, 0))
    y = scan.surface[scan.bodies == 0][:, 1]
    wide = 0.2 * 3 / 1.5  # what the post alone would hide, and more
    assert np.sum((y < 0) & (y > -wide)) < 0.8 * np.sum((y > 0) & (y < wide))


def test_glass_hardly_returns_and_dropouts_are_random():
    world = ROOM.add("glass", box((3.0, -2, 0.2), (3.01, 2, 2.2)), reflectivity=0.04)
    scan = scan_of(world)
    opaque = scan_of(ROOM.add("glass", box((3.0, -2, 0.2), (3.01, 2, 2.2))))
    assert np.mean(scan.bodies == 1) / np.mean(opaque.bodies == 1) == pytest.approx(0.04, rel=0.3)
    rays = get_sensor("utm_30lx").pattern.directions()
    assert len(opaque.points) / (rays.shape[0] * rays.shape[1]) == pytest.approx(1 - 0.003, abs=0.002)


def test_mixed_pixels_lie_between_two_surfaces_only():
    flat = scan_of(
        World().add("floor", box((-30, -30, -0.1), (30, 30, 0))), get_sensor("utm_30lx").with_noise(0.0)
    )
    assert not flat.mixed.any()  # slanted is not an edge
    scan = scan_of(ROOM.add("post", block(0.3, 0.3, 2.5), (2, 0, 0)), get_sensor("utm_30lx").with_noise(0.0))
    assert 20 < scan.mixed.sum() < 2000
    distance = np.linalg.norm(scan.points - scan.origins, axis=1)[scan.mixed]
    assert ((distance > 1.8) & (distance < 5.2)).all()


def test_scan_order_is_line_by_line():
    sensor = get_sensor("utm_30lx").ideal()
    scan = scan_of(ROOM, sensor)
    rays = (scan.surface - scan.origins) / np.linalg.norm(scan.surface - scan.origins, axis=1, keepdims=True)
    step = np.degrees(np.arccos(np.clip(np.sum(rays[1:] * rays[:-1], axis=1), -1, 1)))
    assert np.median(step) == pytest.approx(0.5, abs=0.01)
    assert np.mean(step < 0.6) > 0.99


def test_same_seed_same_bytes_and_other_seed_other_noise():
    one, same, other = (simulate(ROOM, "utm_30lx", (0, 0, 1), seed) for seed in (3, 3, 4))
    assert one.points.tobytes() == same.points.tobytes()
    assert one.points.tobytes() != other.points.tobytes()
    first, second, third = (corridor_pair(seed, density=0.2) for seed in (1, 1, 2))
    for scan in ("reference", "current"):
        assert getattr(first, scan).points.tobytes() == getattr(second, scan).points.tobytes()
        assert getattr(first, scan).labels.tobytes() == getattr(second, scan).labels.tobytes()
        assert getattr(first, scan).points.tobytes() != getattr(third, scan).points.tobytes()


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


@pytest.mark.parametrize("name", BUILDINGS)
@pytest.mark.parametrize("seed", range(8))
def test_every_change_fits_into_every_scene(name, seed):
    scene = make_scene(name, seed)
    for change in CHANGES:
        world = apply_changes(scene, (change,), np.random.default_rng(seed))
        states = [state for state in compare_worlds(scene.world, world).values() if state]
        assert len(states) == 1


def test_new_objects_touch_nothing():
    for seed in range(5):
        scene = make_scene("office", seed)
        world = apply_changes(scene, ("box", "cylinder", "person"), np.random.default_rng(seed))
        added = [
            name for name, state in compare_worlds(scene.world, world).items() if state == BodyState.ADDED
        ]
        assert len(added) == 3
        for name in added:
            others = RayScene(world.remove(name))
            above_floor = world.bodies[name].vertices[world.bodies[name].vertices[:, 2] > 0.06]
            assert others.distance(above_floor).min() > 0.03


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


def test_shapes_are_closed():
    import open3d as o3d

    for mesh in (CUBE, cylinder(0.3, 1.0), sphere((0, 0, 0), 0.5)):
        shape = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(mesh.vertices.copy()),
            o3d.utility.Vector3iVector(mesh.triangles.copy()),
        )
        assert shape.is_watertight()
        assert shape.is_orientable()
