"""Rays against a world: what each one hits, what can be seen from where, how far the nearest surface is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError, MissingDependencyError
from novelty.simulation.world import World

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Hits:
    """What N rays hit.

    Attributes:
        ranges: float32 (N,), m; inf where a ray hits nothing.
        bodies: int32 (N,), position of the object in the world's order; -1 where a ray hits nothing.
        cosines: float32 (N,), |cosine| between ray and surface normal; 0 where a ray hits nothing.
    """

    ranges: NDArray[np.float32]
    bodies: NDArray[np.int32]
    cosines: NDArray[np.float32]


class RayScene:
    """A world made ready for casting rays (Open3D's `RaycastingScene`, which is Embree, in float32).

    Coordinates are relative to the centre of the world, so that a world far from the origin loses no digits.

    Attributes:
        world: The world.
        names: Its object names; `Hits.bodies` points into them.
        reflectivity: float32 (objects,), the share of rays that return from each object.
    """

    def __init__(self, world: World) -> None:
        """Build the acceleration structure.

        Raises:
            InputError: The world has no objects.
            MissingDependencyError: Open3D cannot be imported.
        """
        if not world.bodies:
            raise InputError(
                "The world is empty; add objects with `world.add(name, mesh)` before scanning it."
            )
        open3d = _open3d()
        self.world = world
        self.names = tuple(world.bodies)
        self.reflectivity = np.array([body.reflectivity for body in world.bodies.values()], dtype=np.float32)
        vertices = [body.vertices for body in world.bodies.values()]
        corners = np.concatenate(vertices)
        self._centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        self._scene = open3d.t.geometry.RaycastingScene()
        for points, body in zip(vertices, world.bodies.values(), strict=True):
            self._scene.add_triangles(
                (points - self._centre).astype(np.float32), body.mesh.triangles.astype(np.uint32)
            )

    def cast(self, origins: FloatArray, directions: NDArray[np.float32]) -> Hits:
        """Cast rays.

        Args:
            origins: (..., 3), m, world coordinates; broadcast to the shape of `directions`.
            directions: float32 (..., 3), unit vectors; N of them in all.
        """
        rays = np.empty((*directions.shape[:-1], 6), dtype=np.float32)
        rays[..., :3] = origins - self._centre
        rays[..., 3:] = directions
        answer = self._scene.cast_rays(rays.reshape(-1, 6))
        normals = answer["primitive_normals"].numpy()
        cosines = np.abs(np.einsum("nd,nd->n", normals, directions.reshape(-1, 3)))
        bodies = answer["geometry_ids"].numpy().view(np.int32)  # Open3D's "none" is 2^32 - 1, which is -1
        return Hits(answer["t_hit"].numpy(), bodies, cosines)

    def sees(
        self, origin: FloatArray, points: FloatArray, min_cosine: float = 0.0, tolerance: float = 0.005
    ) -> NDArray[np.bool_]:
        """Whether the straight line from `origin` (3,) to each of `points` (N, 3) is free: (N,).

        The last `tolerance` metres are not looked at, so that a surface does not hide its own points. A
        surface at the point that is met more slantwise than `min_cosine` does not count as seen.
        """
        sight = points - origin
        length = np.linalg.norm(sight, axis=1)
        hits = self.cast(origin, (sight / np.maximum(length, 1e-9)[:, None]).astype(np.float32))
        slanted = (hits.ranges <= length + tolerance) & (hits.cosines < min_cosine)
        return (hits.ranges >= length - tolerance) & ~slanted

    def crossings(self, origin: FloatArray, points: FloatArray) -> NDArray[np.int64]:
        """How many surfaces the straight line from `origin` (3,) to each of `points` (N, 3) crosses: (N,).

        Odd where one end is inside a closed body and the other is not.
        """
        sight = points - origin
        directions = sight / np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-9)
        starts = np.concatenate([np.broadcast_to(origin, points.shape), points]) - self._centre
        rays = np.concatenate([starts, np.tile(directions, (2, 1))], axis=1).astype(np.float32)
        counts = self._scene.count_intersections(rays).numpy().astype(np.int64)
        return counts[: len(points)] - counts[len(points) :]

    def distance(self, points: FloatArray) -> NDArray[np.float32]:
        """Distance (N,), m, from each of `points` (N, 3) to the nearest surface of the world."""
        return self._scene.compute_distance((points - self._centre).astype(np.float32)).numpy()


def _open3d():  # type: ignore[no-untyped-def]
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise MissingDependencyError(
            f"Simulating scans needs Open3D, which cannot be imported ({error}). Run `novelty doctor`."
        ) from error
    return open3d
