"""Rigid poses as (4, 4) matrices: x forward, y left, z up, angles in degrees."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.errors import InputError

FloatArray = NDArray[np.float64]


def make_pose(
    position: ArrayLike = (0.0, 0.0, 0.0), yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0
) -> FloatArray:
    """The pose at `position`, turned by yaw about z, then pitch about y, then roll about x.

    Args:
        position: (3,), m.
        yaw: Degrees, counter-clockwise seen from above.
        pitch: Degrees, positive turns the x axis towards the floor.
        roll: Degrees about the x axis.

    Returns:
        (4, 4) matrix that takes local to world coordinates.
    """
    pose = np.eye(4)
    pose[:3, :3] = rotation((0, 0, 1), yaw) @ rotation((0, 1, 0), pitch) @ rotation((1, 0, 0), roll)
    pose[:3, 3] = np.asarray(position, dtype=np.float64)
    return pose


def look_at(position: ArrayLike, target: ArrayLike) -> FloatArray:
    """The upright pose (4, 4) at `position` (3,) whose x axis points at `target` (3,)."""
    ahead = np.subtract(target, position)
    yaw, pitch = np.arctan2(ahead[1], ahead[0]), -np.arctan2(ahead[2], np.hypot(ahead[0], ahead[1]))
    return make_pose(position, yaw=float(np.degrees(yaw)), pitch=float(np.degrees(pitch)))


def rotation(axis: ArrayLike, degrees: float) -> FloatArray:
    """Rotation matrix (3, 3) about `axis` (3,), by Rodrigues' formula."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def transform(pose: FloatArray, points: ArrayLike) -> FloatArray:
    """`points` (..., 3) taken from local to world coordinates."""
    # einsum: on a busy machine BLAS threads cost more than these nine products per point.
    return np.einsum("...d,ed->...e", np.asarray(points, dtype=np.float64), pose[:3, :3]) + pose[:3, 3]


def inverse(pose: FloatArray) -> FloatArray:
    """The inverse of a rigid pose (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def random_motion(translation: float, degrees: float, rng: np.random.Generator) -> FloatArray:
    """A small rigid motion (4, 4) of exactly the given size, in a random direction and about a random axis.

    Args:
        translation: Length of the shift, m.
        degrees: Angle of the turn.
        rng: Where direction and axis are drawn from.
    """
    direction, axis = rng.standard_normal(3), rng.standard_normal(3)
    motion = np.eye(4)
    motion[:3, :3] = rotation(axis, degrees)
    motion[:3, 3] = translation * direction / np.linalg.norm(direction)
    return motion


def as_pose(value: ArrayLike) -> FloatArray:
    """A pose from a (4, 4) rigid matrix or from a position (3,).

    Raises:
        InputError: The value has another shape, or its upper left block is not a rotation.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.shape == (3,):
        return make_pose(array)
    if array.shape != (4, 4):
        raise InputError(f"A pose must be a (4, 4) matrix or a position (3,); got shape {array.shape}.")
    if (
        not np.allclose(array[:3, :3] @ array[:3, :3].T, np.eye(3), atol=1e-6)
        or np.linalg.det(array[:3, :3]) < 0
    ):
        raise InputError(
            "A pose must be rigid: its upper left 3x3 block is not a rotation. Scale the mesh instead."
        )
    return array
