"""A world of named objects, and what differs between two of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.errors import InputError
from novelty.simulation.meshes import Mesh
from novelty.simulation.poses import as_pose, transform


@dataclass(frozen=True, eq=False)
class Body:
    """One object of a world.

    Attributes:
        name: Its identity: the same name in two worlds is the same object.
        mesh: Its surface, in its own coordinates.
        pose: (4, 4), from its own to world coordinates.
        reflectivity: The share of rays that come back from it: 1 for plaster, near 0 for glass.
    """

    name: str
    mesh: Mesh
    pose: NDArray[np.float64]
    reflectivity: float = 1.0

    @property
    def vertices(self) -> NDArray[np.float64]:
        """(V, 3), m, in world coordinates."""
        return transform(self.pose, self.mesh.vertices)

    def same_surface(self, other: Body) -> bool:
        """Whether both bodies have the same mesh at the same pose."""
        same_mesh = self.mesh is other.mesh or (
            np.array_equal(self.mesh.vertices, other.mesh.vertices)
            and np.array_equal(self.mesh.triangles, other.mesh.triangles)
        )
        return same_mesh and np.allclose(self.pose, other.pose, rtol=0, atol=1e-9)


@dataclass(frozen=True, eq=False)
class World:
    """Objects by name, in the order in which they were added. Every change returns a new world.

    Example:
        >>> from novelty.simulation import World, load_mesh, make_pose
        >>> world = World().add("machine", load_mesh("machine.glb"))             # doctest: +SKIP
        >>> later = world.move("machine", make_pose((1.0, 0.0, 0.0), yaw=30))    # doctest: +SKIP
    """

    bodies: Mapping[str, Body] = field(default_factory=dict)

    def add(
        self, name: str, mesh: Mesh, pose: ArrayLike = (0.0, 0.0, 0.0), reflectivity: float = 1.0
    ) -> World:
        """This world with one more object.

        Args:
            name: A name that is not in use.
            mesh: The object's surface.
            pose: (4, 4), or a position (3,).
            reflectivity: The share of rays that come back from it.

        Raises:
            InputError: The name is taken, or the pose is not rigid.
        """
        if name in self.bodies:
            raise InputError(f"The world already has an object {name!r}; choose another name or `move` it.")
        return World({**self.bodies, name: Body(name, mesh, as_pose(pose), reflectivity)})

    def remove(self, name: str) -> World:
        """This world without one object.

        Raises:
            InputError: There is no such object.
        """
        self._known(name)
        return World({key: body for key, body in self.bodies.items() if key != name})

    def move(self, name: str, pose: ArrayLike) -> World:
        """This world with one object at another pose, (4, 4) or a position (3,).

        Raises:
            InputError: There is no such object, or the pose is not rigid.
        """
        body = self._known(name)
        return World({**self.bodies, name: replace(body, pose=as_pose(pose))})

    def _known(self, name: str) -> Body:
        if name not in self.bodies:
            raise InputError(f"The world has no object {name!r}; it has {', '.join(self.bodies) or 'none'}.")
        return self.bodies[name]


class BodyState(IntEnum):
    """What happened to an object between two worlds."""

    UNCHANGED = 0
    ADDED = 1
    REMOVED = 2
    MOVED = 3


def compare_worlds(before: World, after: World) -> dict[str, BodyState]:
    """What happened to every object of either world, by name; a changed mesh counts as moved."""
    states = {}
    for name in [*before.bodies, *(name for name in after.bodies if name not in before.bodies)]:
        if name not in after.bodies:
            states[name] = BodyState.REMOVED
        elif name not in before.bodies:
            states[name] = BodyState.ADDED
        else:
            same = before.bodies[name].same_surface(after.bodies[name])
            states[name] = BodyState.UNCHANGED if same else BodyState.MOVED
    return states
