"""Scenes and what may change in them."""

import numpy as np
import pytest

from novelty.simulation import (
    CHANGES,
    SCENES,
    BodyState,
    RayScene,
    apply_changes,
    compare_worlds,
    get_sensor,
    join,
    make_pose,
    make_scene,
    measure,
    mesh_scene,
    simulate_pair,
)
from novelty.simulation.shapes import block, box

BUILDINGS = sorted(set(SCENES) - {"ideal_corridor", "relief"})


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


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_the_same_for_the_same_seed(name):
    one, same = make_scene(name, 7), make_scene(name, 7)
    assert list(one.world.bodies) == list(same.world.bodies)
    assert not any(compare_worlds(one.world, same.world).values())


@pytest.mark.parametrize("name", BUILDINGS)
def test_a_building_differs_from_seed_to_seed_and_has_all_that_is_expected(name):
    scene, other = make_scene(name, 1), make_scene(name, 2)
    assert any(compare_worlds(scene.world, other.world).values())
    assert len(scene.open_doors) >= 1
    assert len(scene.movable) >= 4
    assert len(scene.world.bodies) > 15
    for door, opened in scene.open_doors.items():  # on its hinge
        assert np.allclose(opened[:3, 3], scene.world.bodies[door].pose[:3, 3])
        assert not np.allclose(opened[:3, 0], scene.world.bodies[door].pose[:3, 0])


@pytest.mark.parametrize("name", BUILDINGS)
def test_a_window_returns_little(name):
    scene = make_scene(name, 3)
    glass = [body for body in scene.world.bodies.values() if body.reflectivity < 0.5]
    assert len(glass) == 1
    middle = glass[0].vertices.mean(axis=0)
    inward = scene.viewpoint[:3, 3] - middle
    inside = make_pose(middle + inward / np.linalg.norm(inward))  # a metre in front of the pane
    scan = measure(RayScene(scene.world), get_sensor("vlp_16"), inside[None], np.random.default_rng(0))
    hit = scan.bodies == list(scene.world.bodies).index(glass[0].name)
    assert 0 < hit.mean() < 0.05


def plain_hall():
    """A building that is one mesh, 8 m x 6 m, with a column."""
    walls = [box((-4, y, 0), (4, y + 0.1, 2.6)) for y in (-3, 2.9)] + [
        box((x, -3, 0), (x + 0.1, 3, 2.6)) for x in (-4, 3.9)
    ]
    return join([box((-4, -3, -0.1), (4, 3, 0)), *walls, block(0.4, 0.4, 2.6)])


def test_things_appear_move_and_go_in_an_own_mesh():
    table = box((1, 1.2, 0), (1.6, 1.8, 0.8))
    scene = mesh_scene({"hall": plain_hall(), "table": table}, (-3.0, 0.0, 1.2), movable=("table",))
    assert np.allclose(scene.world.bodies["table"].vertices, table.vertices)
    for seed in range(5):
        pair = simulate_pair(scene, seed, ("move", "person", "box"), density=0.2)
        states = {name: state for name, state in compare_worlds(pair.before, pair.after).items() if state}
        assert states == {"table": BodyState.MOVED, "person 1": BodyState.ADDED, "box 1": BodyState.ADDED}
        for name in states:
            others = RayScene(pair.after.remove(name))
            body = pair.after.bodies[name].vertices
            assert others.distance(body[body[:, 2] > 0.06]).min() > 0.03
            assert (np.abs(body[:, :2]) < (3.9, 2.9)).all()
    gone = simulate_pair(scene, 0, ("remove",), density=0.2)
    assert "table" not in gone.after.bodies
