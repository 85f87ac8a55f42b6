"""A place to scan: a world, where a sensor stands in it, where new things may go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from novelty.errors import InputError
from novelty.simulation.meshes import Mesh
from novelty.simulation.poses import FloatArray, as_pose, transform
from novelty.simulation.world import World

ROBOT_RADIUS = 0.27
"""Half the width of the lane that a robot needs, m: a Pioneer 3-AT is 0.5 m wide."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A world together with what an experiment has to know about it.

    Attributes:
        name: Of the generator that made it.
        world: The objects, all doors closed.
        floor: (2, 2), lower and upper corner of the floor on which new objects may stand, m.
        viewpoint: (4, 4), where a sensor stands by default; it looks along its x axis.
        open_doors: Pose (4, 4) of every door leaf when it is open, by object name.
        movable: Names of objects that may be moved or taken away.
        focus: (3,), near which new objects go and doors open, m; None: 3 m ahead of the viewpoint.
        search: How far from the focus a free spot is looked for, m, and how far off the line of sight, degrees; the
            next where the one before has none.
        path: (W, 2), places that a robot drives by, m; None where it cannot.
        keep_free: (R, 2, 2), rectangles of the floor where nothing new may stand, lower and upper corner, m.
        enclosing: Names of objects that new ones stand in, not beside: a whole building that is one mesh.
    """

    name: str
    world: World
    floor: FloatArray
    viewpoint: FloatArray
    open_doors: Mapping[str, FloatArray] = field(default_factory=dict)
    movable: Sequence[str] = ()
    focus: FloatArray | None = None
    search: Sequence[tuple[float, float]] = ((2.0, 25.0), (5.0, 180.0))
    path: FloatArray | None = None
    keep_free: FloatArray = field(default_factory=lambda: np.empty((0, 2, 2)))
    enclosing: Sequence[str] = ()

    @property
    def aim(self) -> FloatArray:
        """(3,), m, the focus or what stands for it."""
        return ahead(self.viewpoint, 3.0) if self.focus is None else self.focus

    def with_focus(self, forward: float, left: float) -> Scene:
        """This scene with new objects as near as there is room to a point of the viewpoint's own frame, m."""
        near = tuple((reach, 180.0) for reach in (0.15, 0.4, 1.0, 2.0))
        return replace(self, focus=transform(self.viewpoint, (forward, left, 0.0)), search=near)

    def with_stretch(self, first: float, last: float) -> Scene:
        """This scene with a path that leads from x = `first` to x = `last` at most, m.

        Raises:
            InputError: No path leads through the scene.
        """
        path = self._known_path().copy()
        path[:, 0] = np.clip(path[:, 0], first, last)
        return replace(self, path=path)

    def with_free_path(self) -> Scene:
        """This scene with nothing new in a robot's way.

        Raises:
            InputError: No path leads through the scene.
        """
        path = self._known_path()
        ends = np.stack([path[:-1], path[1:]], axis=1)  # (W - 1, 2, 2)
        lanes = np.stack([ends.min(axis=1) - ROBOT_RADIUS, ends.max(axis=1) + ROBOT_RADIUS], axis=1)
        return replace(self, keep_free=np.concatenate([self.keep_free, lanes]))

    def _known_path(self) -> FloatArray:
        if self.path is None:
            raise InputError(f"No path for a robot leads through the scene {self.name!r}.")
        return self.path


def mesh_scene(
    meshes: Mapping[str, Mesh],
    viewpoint: ArrayLike,
    floor: ArrayLike | None = None,
    movable: Sequence[str] = (),
    name: str = "mesh",
) -> Scene:
    """A scene of own meshes, in which things may appear, be moved and be taken away as in the others.

    Args:
        meshes: Objects by name, in world coordinates: z up, the floor at z = 0, m. Those that are not movable may
            enclose the place, as the walls of a building that is one mesh do.
        viewpoint: Where the sensor stands: a position (3,) or a pose (4, 4); it looks along its x axis.
        floor: (2, 2), lower and upper corner of the floor on which new objects may stand, m; what the meshes cover
            when None.
        movable: Names of objects that may be moved or taken away.
        name: Of the scene.

    Example:
        >>> from novelty.simulation import load_mesh, mesh_scene, simulate_pair
        >>> scene = mesh_scene({"hall": load_mesh("hall.glb")}, (2.0, 0.0, 1.2))         # doctest: +SKIP
        >>> pair = simulate_pair(scene, seed=0, changes=("person", "box"))               # doctest: +SKIP
    """
    world = World()
    for mesh_name, mesh in meshes.items():
        at = np.append((mesh.vertices[:, :2].min(axis=0) + mesh.vertices[:, :2].max(axis=0)) / 2, 0.0)
        world = world.add(mesh_name, Mesh(mesh.vertices - at, mesh.triangles), at)
    corners = np.concatenate([mesh.vertices[:, :2] for mesh in meshes.values()])
    covered = (
        np.stack([corners.min(axis=0), corners.max(axis=0)])
        if floor is None
        else np.array(floor, dtype=float)
    )
    fixed = tuple(name for name in meshes if name not in movable)
    return Scene(name, world, covered, as_pose(viewpoint), movable=tuple(movable), enclosing=fixed)


def footprints(world: World, without: Sequence[str] = ()) -> FloatArray:
    """Rectangles (objects, 2, 2) on the floor, lower and upper corner, taken up by what stands below head height."""
    boxes = [
        np.stack([body.vertices.min(axis=0), body.vertices.max(axis=0)])
        for body in world.bodies.values()
        if body.name not in without
    ]
    return np.array(
        [corners[:, :2] for corners in boxes if corners[0, 2] < 1.9 and corners[1, 2] > 0.02],
        dtype=np.float64,
    ).reshape(-1, 2, 2)


def ahead(viewpoint: FloatArray, distance: float) -> FloatArray:
    """The point (3,) straight ahead of a pose."""
    return transform(viewpoint, (distance, 0.0, 0.0))
