"""What may happen to a scene between two scans: things appear, are moved or taken away, doors open."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.simulation.meshes import Mesh
from novelty.simulation.poses import FloatArray, inverse, make_pose, transform
from novelty.simulation.raycast import RayScene
from novelty.simulation.scenes import furniture
from novelty.simulation.scenes.people import PERSON_POSES, person
from novelty.simulation.scenes.scene import Scene, footprints
from novelty.simulation.world import World

CLEARANCE = 0.08
"""Free space kept round a new object, m."""

IN_SIGHT = 0.15
"""Share of an object's corners that must be seen for it to be moved or taken away."""

Change = Callable[[Scene, World, np.random.Generator, float | None], World]
"""From the scene, the world so far, a generator and a size (m; None: the usual one) to the new world."""


def add_person(scene: Scene, world: World, rng: np.random.Generator, size: float | None = None) -> World:
    """A person of height `size` (1.75 m) on a free and visible spot, in a random pose that has room there."""
    drawn = str(rng.choice(list(PERSON_POSES)))
    poses = sorted(PERSON_POSES, key=lambda pose: pose != drawn)
    return _insert(scene, world, "person", (person(pose, size or 1.75) for pose in poses), rng)


def add_box(scene: Scene, world: World, rng: np.random.Generator, size: float | None = None) -> World:
    """A packing box of height `size` (0.5 m) on a free and visible spot."""
    return _insert(scene, world, "box", [furniture.carton(size or 0.5)], rng)


def add_cylinder(scene: Scene, world: World, rng: np.random.Generator, size: float | None = None) -> World:
    """A drum of diameter `size` (0.45 m) on a free and visible spot."""
    return _insert(scene, world, "cylinder", [furniture.drum(size or 0.45)], rng)


def open_door(scene: Scene, world: World, rng: np.random.Generator, size: float | None = None) -> World:
    """One of the closed doors nearest to what the sensor looks at (to within 1 m) is opened.

    Raises:
        InputError: All doors are open, or the scene has none.
    """
    closed = [name for name in scene.open_doors if world.bodies[name].pose is scene.world.bodies[name].pose]
    if not closed:
        raise InputError(f"The scene {scene.name!r} has no closed door left to open.")
    distance = [np.linalg.norm(world.bodies[name].vertices.mean(axis=0) - scene.aim) for name in closed]
    near = [name for name, far in zip(closed, distance, strict=True) if far <= min(distance) + 1]
    door = str(rng.choice(near))
    return world.move(door, scene.open_doors[door])


def move_object(scene: Scene, world: World, rng: np.random.Generator, size: float | None = None) -> World:
    """A movable object goes to a free spot `size` metres at most from where it was (1.5 m), turned at random.

    Raises:
        InputError: No movable object has a free spot within reach.
    """
    for name in rng.permutation(_movable(scene, world)):
        body = world.bodies[str(name)]
        pose = _free_spot(
            scene, world.remove(body.name), body.mesh, rng, near=body.pose[:3, 3], reach=size or 1.5
        )
        if pose is not None:
            return world.move(body.name, pose)
    raise InputError(f"Nothing in the scene {scene.name!r} can be moved to a free and visible spot.")


def remove_object(scene: Scene, world: World, rng: np.random.Generator, size: float | None = None) -> World:
    """A movable object is taken away.

    Raises:
        InputError: No movable object is left.
    """
    names = _movable(scene, world)
    if not names:
        raise InputError(f"The scene {scene.name!r} has nothing left that can be taken away.")
    return world.remove(str(rng.choice(names)))


CHANGES: dict[str, Change] = {
    "person": add_person,
    "box": add_box,
    "cylinder": add_cylinder,
    "door": open_door,
    "move": move_object,
    "remove": remove_object,
}
"""Changes by name."""


def apply_changes(
    scene: Scene, changes: tuple[str, ...], rng: np.random.Generator, size: float | None = None
) -> World:
    """The scene's world after changes, by their names in `CHANGES`.

    Doors open first, so that nothing new stands in their way.

    Raises:
        InputError: There is no change of that name, or no room for it.
    """
    unknown = [name for name in changes if name not in CHANGES]
    if unknown:
        raise InputError(f"There is no change {unknown[0]!r}; choose from {', '.join(CHANGES)}.")
    world = scene.world
    for name in sorted(changes, key=lambda change: change != "door"):
        world = CHANGES[name](scene, world, rng, size)
    return world


def _insert(scene: Scene, world: World, name: str, meshes: Iterable[Mesh], rng: np.random.Generator) -> World:
    """The first of the meshes that has room, as near to the scene's aim as there is room."""
    number = 1 + sum(other.split(" ")[0] == name for other in world.bodies)
    for mesh, (reach, bearing) in itertools.product(meshes, scene.search):
        pose = _free_spot(scene, world, mesh, rng, near=scene.aim, reach=reach, bearing=bearing)
        if pose is not None:
            return world.add(f"{name} {number}", mesh, pose)
    raise InputError(
        f"No free and visible spot for a {name} in the scene {scene.name!r}; "
        "use a smaller object or another seed."
    )


def _movable(scene: Scene, world: World) -> list[str]:
    """Movable objects that stand on the floor where they stood at first, in sight of the viewpoint."""
    eye, rays = scene.viewpoint[:3, 3], RayScene(world)
    present = [name for name in scene.movable if name in world.bodies]
    return [
        name
        for name in present
        if world.bodies[name].pose is scene.world.bodies[name].pose
        and abs(world.bodies[name].pose[2, 3]) < 0.01
        and rays.sees(eye, world.bodies[name].vertices).mean() > IN_SIGHT
    ]


def _free_spot(
    scene: Scene,
    world: World,
    mesh: Mesh,
    rng: np.random.Generator,
    *,
    near: FloatArray,
    reach: float,
    bearing: float = 180.0,
) -> FloatArray | None:
    """A pose (4, 4) on the floor near a point, touching nothing and seen from the viewpoint; None if there is none."""
    radius = float(np.linalg.norm(mesh.vertices[:, :2], axis=1).max()) + CLEARANCE
    low = np.maximum(scene.floor[0] + radius - CLEARANCE, near[:2] - reach)
    high = np.minimum(scene.floor[1] - radius + CLEARANCE, near[:2] + reach)
    if (low >= high).any():
        return None
    spots = rng.uniform(low, high, (400, 2))
    rectangles = np.concatenate([footprints(world, scene.enclosing), scene.keep_free])
    nearest = np.clip(spots[:, None], rectangles[None, :, 0], rectangles[None, :, 1])  # (spots, objects, 2)
    gap = np.linalg.norm(nearest - spots[:, None], axis=2).min(axis=1, initial=np.inf)
    seen_at = transform(inverse(scene.viewpoint), np.column_stack([spots, np.zeros(len(spots))]))
    far_enough = np.linalg.norm(seen_at[:, :2], axis=1) > radius + 0.7
    ahead_enough = np.abs(np.degrees(np.arctan2(seen_at[:, 1], seen_at[:, 0]))) <= bearing
    spots = spots[(gap > radius) & far_enough & ahead_enough]
    height = float(mesh.vertices[:, 2].max())
    middle = np.column_stack([spots, np.full(len(spots), height / 2)])
    visible = spots[RayScene(world).sees(scene.viewpoint[:3, 3], middle)] if len(spots) else spots
    if scene.enclosing:
        visible = visible[_clear(RayScene(world), visible, radius, height)]
    if not len(visible):
        return None
    return make_pose((*visible[0], 0.0), yaw=rng.uniform(-180, 180))


def _clear(scene: RayScene, spots: FloatArray, radius: float, height: float) -> NDArray[np.bool_]:
    """Whether a disc of `radius` m, as high as a new object, touches no surface at each of `spots` (N, 2): (N,)."""
    angles = 2 * np.pi * np.arange(12) / 12
    rim = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    levels = np.linspace(CLEARANCE, height, 6)
    around = np.array([[*place, level] for place in [*rim, *(rim / 2), np.zeros(2)] for level in levels])
    places = np.pad(spots, ((0, 0), (0, 1)))[:, None] + around  # (N, places, 3)
    gaps = scene.distance(places.reshape(-1, 3)).reshape(len(spots), -1)
    return gaps.min(axis=1, initial=np.inf) >= CLEARANCE / 2
