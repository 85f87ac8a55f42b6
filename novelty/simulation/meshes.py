"""Triangle meshes: the surface of one object, in its own coordinates."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.errors import InputError
from novelty.simulation.poses import transform


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh.

    Attributes:
        vertices: float64 (V, 3), m.
        triangles: int32 (F, 3), rows of `vertices`.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike) -> None:
        """Check the shapes and store read-only copies.

        Raises:
            InputError: A shape is wrong, a vertex is not finite, or a triangle names no vertex.
        """
        corners = np.array(vertices, dtype=np.float64)
        faces = np.array(triangles, dtype=np.int32)
        if (
            corners.ndim != 2
            or corners.shape[1] != 3
            or faces.ndim != 2
            or faces.shape[1] != 3
            or not len(faces)
        ):
            raise InputError(
                "A mesh needs vertices (V, 3) and at least one triangle (F, 3); "
                f"got {corners.shape} and {faces.shape}."
            )
        if not np.isfinite(corners).all() or faces.min() < 0 or faces.max() >= len(corners):
            raise InputError("A mesh needs finite vertices and triangles that name existing vertices.")
        corners.flags.writeable = faces.flags.writeable = False
        object.__setattr__(self, "vertices", corners)
        object.__setattr__(self, "triangles", faces)

    @property
    def areas(self) -> NDArray[np.float64]:
        """(F,), m^2, of the triangles."""
        first, second, third = self.vertices[self.triangles.T]
        return np.linalg.norm(np.cross(second - first, third - first), axis=1) / 2

    def sample(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Points (count, 3) drawn evenly from the surface."""
        areas = self.areas
        corners = self.vertices[self.triangles[rng.choice(len(areas), count, p=areas / areas.sum())]]
        weights = rng.dirichlet((1.0, 1.0, 1.0), count)  # even over a triangle
        return np.einsum("nc,ncd->nd", weights, corners)

    def moved(self, pose: NDArray[np.float64]) -> Mesh:
        """This mesh with `pose` (4, 4) applied to its vertices."""
        return Mesh(transform(pose, self.vertices), self.triangles)

    def scaled(self, factors: ArrayLike) -> Mesh:
        """This mesh stretched by one factor, or by one per axis (3,)."""
        return Mesh(self.vertices * np.asarray(factors, dtype=np.float64), self.triangles)


def join(meshes: Iterable[Mesh]) -> Mesh:
    """One mesh of several, not welded: enough for casting rays."""
    parts = list(meshes)
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=True)]),
    )


def load_mesh(path: str | Path, scale: float = 1.0) -> Mesh:
    """Read a mesh from any file that Open3D reads (OBJ, PLY, STL, OFF, GLB, GLTF).

    Args:
        path: The file.
        scale: Factor from the file's unit to metres, such as 0.001 for millimetres.

    Raises:
        InputError: The file is missing or holds no triangles.
    """
    import open3d as o3d

    file = Path(path)
    if not file.is_file():
        raise InputError(f"{file}: no such mesh file.")
    mesh = o3d.io.read_triangle_mesh(file)
    if not mesh.has_triangles():
        raise InputError(
            f"{file}: no triangles could be read; expected OBJ, PLY, STL, OFF, GLB or GLTF with faces."
        )
    return Mesh(np.asarray(mesh.vertices) * scale, np.asarray(mesh.triangles))
