"""A robot that drives while it scans: where it really was, and where its localisation says it was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from novelty.errors import InputError
from novelty.simulation.measure import Measurement, measure
from novelty.simulation.poses import FloatArray, make_pose
from novelty.simulation.raycast import RayScene
from novelty.simulation.sensors import Sensor


@dataclass(frozen=True, eq=False)
class Drive:
    """One pass of a robot.

    Attributes:
        poses: (S, 4, 4), where the sensor really was at each line.
        believed: (S, 4, 4), where the robot thinks that it was.
    """

    poses: FloatArray
    believed: FloatArray


def drive(
    start: ArrayLike,
    end: ArrayLike,
    spacing: float = 0.05,
    drift: tuple[float, float] = (0.0, 0.0),
    rng: np.random.Generator | None = None,
) -> Drive:
    """A straight pass at constant height from `start` to `end`, (3,) each, with one pose every `spacing` metres.

    The localisation error is a random walk: after d metres the believed position errs by `drift[0] * sqrt(d)` metres
    (standard deviation, along and across) and the believed heading by `drift[1] * sqrt(d)` degrees.

    Args:
        start: Position of the sensor at the first line, m.
        end: Position of the sensor at the last line, m.
        spacing: Distance between two lines, m.
        drift: Size of the error, m and degrees per square root of a metre. After scan matching a few millimetres and
            tenths of a degree are usual.
        rng: Where the error is drawn from; needed when `drift` is not zero.

    Raises:
        InputError: `start` and `end` are the same place, or a drift is asked for without `rng`.
    """
    first, last = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(last - first))
    if length == 0:
        raise InputError("A drive needs two different places; start and end are the same.")
    count = int(length / spacing) + 1
    yaw = np.degrees(np.arctan2(last[1] - first[1], last[0] - first[0]))
    places = first + (last - first) * (np.arange(count) * spacing / length)[:, None]
    poses = np.stack([make_pose(place, yaw) for place in places])
    if not any(drift):
        return Drive(poses, poses)
    if rng is None:
        raise InputError("A drive with drift needs a generator: pass rng=np.random.default_rng(seed).")
    steps = rng.standard_normal((count, 3)) * (drift[0], drift[0], drift[1]) * np.sqrt(spacing)
    errors = [make_pose((x, y, 0.0), turn) for x, y, turn in np.cumsum(steps, axis=0)]
    return Drive(poses, poses @ np.stack(errors))


def measure_drive(scene: RayScene, sensor: Sensor, way: Drive, rng: np.random.Generator) -> Measurement:
    """Scan `scene` from the real poses and report the points where the robot believes them to be."""
    return measure(scene, sensor, way.poses, rng).believed_at(way.believed)
