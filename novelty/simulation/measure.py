"""One scan of a world: rays are cast, returns are lost, distances are read with the sensor's errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.scan import Scan
from novelty.simulation.poses import FloatArray, as_pose, inverse, transform
from novelty.simulation.raycast import Hits, RayScene
from novelty.simulation.sensors import Sensor, get_sensor
from novelty.simulation.world import World

EDGE = 0.05
"""Smallest step between the distances of neighbouring rays that can be a depth edge, m."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """A scan with everything that is known about it because it was simulated. N counts the returns.

    Attributes:
        scene: The world that was scanned.
        sensor: What scanned it.
        poses: (S, 4, 4), where the sensor really stood, one per sweep.
        points: (N, 3), m, as the sensor reports them, in scan order.
        sweeps: (N,), the pose from which each point was measured.
        directions: float32 (N, 3), unit vectors of the rays.
        ranges: float32 (N,), m, the distance that a perfect sensor would have read.
        bodies: int32 (N,), the object that was hit, a position in `scene.names`.
        mixed: bool (N,), whether the reading lies between two surfaces.
        believed: (S, 4, 4), the poses at which the sensor reports its points; `poses` unless localisation erred.
    """

    scene: RayScene
    sensor: Sensor
    poses: FloatArray
    points: FloatArray
    sweeps: NDArray[np.intp]
    directions: NDArray[np.float32]
    ranges: NDArray[np.float32]
    bodies: NDArray[np.int32]
    mixed: NDArray[np.bool_]
    believed: FloatArray

    @property
    def origins(self) -> FloatArray:
        """(N, 3), m, where each ray started."""
        return self.poses[self.sweeps, :3, 3]

    @cached_property
    def surface(self) -> FloatArray:
        """(N, 3), m, the point of the surface that each ray hit, without noise."""
        return _along(self.poses, self.sweeps, self.directions, self.ranges)

    def believed_at(self, believed: FloatArray) -> Measurement:
        """The same readings, reported at other poses (S, 4, 4)."""
        motions = np.stack([new @ inverse(old) for new, old in zip(believed, self.believed, strict=True)])[
            self.sweeps
        ]
        points = np.einsum("ned,nd->ne", motions[:, :3, :3], self.points) + motions[:, :3, 3]
        return replace(self, points=points, believed=believed)

    def scan(self, labels: NDArray[np.uint8] | None = None, name: str = "") -> Scan:
        """The scan that a detector is given."""
        origin = self.believed[self.sweeps, :3, 3] if len(self.poses) > 1 else self.believed[0, :3, 3]
        return Scan(self.points, origin=origin, labels=labels, name=name)


def simulate(world: World, sensor: str | Sensor, pose: ArrayLike, seed: int = 0) -> Scan:
    """Scan a world.

    Args:
        world: Any world: that of a scene, or own meshes (`World().add("hall", load_mesh("hall.obj"))`).
        sensor: A sensor or its name in `SENSORS`.
        pose: Where it stands: a position (3,) or a pose (4, 4); (S, 3) or (S, 4, 4) for several sweeps.
        seed: Of noise and lost returns; the same seed gives the same scan.

    Returns:
        The scan in world coordinates, points in the order in which the sensor delivers them.
    """
    return measure(RayScene(world), get_sensor(sensor), as_poses(pose), np.random.default_rng(seed)).scan()


def as_poses(value: ArrayLike) -> FloatArray:
    """Poses (S, 4, 4) from one pose or position, or a sequence of them."""
    array = np.asarray(value, dtype=np.float64)
    single = array.shape in {(3,), (4, 4)}
    return np.stack([as_pose(array)] if single else [as_pose(pose) for pose in array])


def measure(scene: RayScene, sensor: Sensor, poses: FloatArray, rng: np.random.Generator) -> Measurement:
    """Scan `scene` with one sweep at each of `poses` (S, 4, 4); the same state of `rng` gives the same scan."""
    local = sensor.pattern.directions()  # (lines, rays, 3)
    turns = poses[:, None, :3, :3].transpose(0, 1, 3, 2).astype(np.float32)
    directions = np.matmul(local, turns)  # (S, lines, rays, 3)
    grid = (len(poses), local.shape[0], local.shape[1])
    hits = scene.cast(poses[:, None, None, :3, 3], directions)
    returned = _returned(scene, sensor, hits, rng)
    read = _read(sensor, np.tile(local[..., 0].ravel(), len(poses)), hits.ranges, rng)
    mixed = _mix(sensor, read, hits, grid, rng)
    kept = np.flatnonzero(returned)
    sweeps, rays, ranges = kept // local[..., 0].size, directions.reshape(-1, 3)[kept], hits.ranges[kept]
    if sensor.emitter is not None:
        emitters = np.stack([transform(pose, sensor.emitter) for pose in poses])
        lit = _lit(scene, emitters, sweeps, _along(poses, sweeps, rays, ranges))
        kept, sweeps, rays, ranges = kept[lit], sweeps[lit], rays[lit], ranges[lit]
    points = _along(poses, sweeps, rays, read[kept])
    return Measurement(
        scene, sensor, poses, points, sweeps, rays, ranges, hits.bodies[kept], mixed[kept], poses
    )


def _along(
    poses: FloatArray, sweeps: NDArray[np.intp], directions: NDArray[np.float32], ranges: NDArray[np.float32]
) -> FloatArray:
    """Points (N, 3) at `ranges` along rays."""
    points = directions.astype(np.float64)
    points *= ranges[:, None]
    points += poses[0, :3, 3] if len(poses) == 1 else poses[sweeps, :3, 3]
    return points


def _returned(scene: RayScene, sensor: Sensor, hits: Hits, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which rays come back: reflected and not lost, in range, not too grazing."""
    luck = rng.random(len(hits.ranges), dtype=np.float32)
    chance = np.float32(1 - sensor.dropout) * np.append(scene.reflectivity, np.float32(0))[hits.bodies]
    returned = (luck < chance) & (hits.ranges >= sensor.min_range) & (hits.ranges <= sensor.max_range)
    return returned & (hits.cosines >= sensor.min_cosine)


def _lit(
    scene: RayScene, emitters: FloatArray, sweeps: NDArray[np.intp], surface: FloatArray
) -> NDArray[np.bool_]:
    """Which of the points (N, 3) the light of their sweep reaches, from one of `emitters` (S, 3)."""
    lit = np.zeros(len(surface), dtype=np.bool_)
    for index, emitter in enumerate(emitters):
        rows = np.flatnonzero(sweeps == index)
        lit[rows] = scene.sees(emitter, surface[rows])
    return lit


def _read(
    sensor: Sensor, axis_cosines: NDArray[np.float32], ranges: NDArray[np.float32], rng: np.random.Generator
) -> NDArray[np.float32]:
    """Readings (N,), m; where a ray hits nothing, a number that nobody uses."""
    finite = np.where(np.isfinite(ranges), ranges, np.float32(sensor.max_range))
    return sensor.ranging.read(finite, axis_cosines, rng)


def _mix(
    sensor: Sensor,
    read: NDArray[np.float32],
    hits: Hits,
    grid: tuple[int, int, int],
    rng: np.random.Generator,
) -> NDArray[np.bool_]:
    """Let beams that straddle a depth edge answer from in between, changing `read`; which ones: (N,)."""
    mixed = np.zeros(len(read), dtype=np.bool_)
    if not sensor.mixed_pixels:
        return mixed
    first, stride = _edges(sensor, hits, grid)
    chosen = first[rng.random(len(first)) < sensor.mixed_pixels]
    share = rng.random(len(chosen), dtype=np.float32)
    second = rng.random(len(chosen)) < 0.5  # either side of the edge may be the one that straddles it
    row = chosen + stride * second
    read[row] = read[chosen] * (1 - share) + read[chosen + stride] * share
    mixed[row] = True
    return mixed


def _edges(sensor: Sensor, hits: Hits, grid: tuple[int, int, int]) -> tuple[NDArray[np.int_], int]:
    """Rays with a depth edge between them and the next, and how many places later the next one comes.

    A slanted surface also makes neighbouring distances differ, by range * angle / cosine of incidence: no edge.
    """
    axis = sensor.pattern.neighbour_axis + 1  # the first axis of the grid counts sweeps
    stride = grid[2] if axis == 1 else 1
    ranges = hits.ranges.reshape(grid)
    with np.errstate(invalid="ignore"):  # inf - inf where neither ray hits anything
        step = np.abs(np.diff(ranges, axis=axis))
    place = np.nonzero((step > EDGE) & (step < np.inf))
    first = np.ravel_multi_index(place, grid)
    nearer = np.minimum(hits.ranges[first], hits.ranges[first + stride])
    cosine = np.minimum(hits.cosines[first], hits.cosines[first + stride])
    slant = 3 * nearer * sensor.pattern.neighbour_angle / np.maximum(cosine, 0.02)
    return first[step[place] > slant], stride
