"""Worlds, meshes and shapes, and what cannot be done with them."""

import json
import struct

import numpy as np
import pytest

from novelty.errors import InputError
from novelty.simulation import (
    BodyState,
    Mesh,
    World,
    compare_worlds,
    corridor_pair,
    drive,
    get_sensor,
    load_mesh,
    make_scene,
    simulate,
    simulate_pair,
)
from novelty.simulation.shapes import box, cylinder, sphere
from tests.novelty.simulation.worlds import CUBE, ROOM


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


def test_shapes_are_closed():
    import open3d as o3d

    for mesh in (CUBE, cylinder(0.3, 1.0), sphere((0, 0, 0), 0.5)):
        shape = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(mesh.vertices.copy()),
            o3d.utility.Vector3iVector(mesh.triangles.copy()),
        )
        assert shape.is_watertight()
        assert shape.is_orientable()
