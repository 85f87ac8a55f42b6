"""A robot that drives while it scans: where it really was, and where its localisation says it was."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

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
    *places: ArrayLike,
    spacing: float = 0.05,
    drift: tuple[float, float] = (0.0, 0.0),
    mounting: tuple[float, float] = (0.0, 0.0),
    rng: np.random.Generator | None = None,
) -> Drive:
    """A pass at constant height along straight lines between `places`, (3,) each, with a pose every `spacing` metres.

    The localisation error is a random walk: after d metres the believed position errs by `drift[0] * sqrt(d)` metres
    (standard deviation, along and across) and the believed heading by `drift[1] * sqrt(d)` degrees. A laser that is
    not mounted as upright as the robot believes shows what it passes twice in two places: on the way back the error
    points the other way. That is the doubled ceiling of section 3.5.

    Args:
        *places: Where the sensor is at the first line, at every turn and at the last line, m.
        spacing: Distance between two lines, m.
        drift: Size of the error, m and degrees per square root of a metre. After scan matching a few millimetres and
            tenths of a degree are usual.
        mounting: Roll and pitch of the laser against what is believed, degrees.
        rng: Where the error is drawn from; needed when `drift` is not zero.

    Raises:
        InputError: Fewer than two places, the same place twice in a row, or a drift without `rng`.
    """
    corners = np.array(places, dtype=np.float64).reshape(-1, 3)
    if len(corners) < 2 or not np.linalg.norm(np.diff(corners, axis=0), axis=1).all():
        raise InputError(
            "A drive needs two different places, one after the other; start and end are the same."
        )
    poses = np.concatenate([_leg(first, last, spacing) for first, last in pairwise(corners)])
    real = poses @ make_pose(roll=mounting[0], pitch=mounting[1]) if any(mounting) else poses
    if not any(drift):
        return Drive(real, poses)
    if rng is None:
        raise InputError("A drive with drift needs a generator: pass rng=np.random.default_rng(seed).")
    steps = rng.standard_normal((len(poses), 3)) * (drift[0], drift[0], drift[1]) * np.sqrt(spacing)
    errors = [make_pose((x, y, 0.0), turn) for x, y, turn in np.cumsum(steps, axis=0)]
    return Drive(real, poses @ np.stack(errors))


def _leg(first: FloatArray, last: FloatArray, spacing: float) -> FloatArray:
    """Poses (S, 4, 4) from one place (3,) to the next, looking ahead."""
    length = float(np.linalg.norm(last - first))
    yaw = np.degrees(np.arctan2(last[1] - first[1], last[0] - first[0]))
    along = np.arange(int(length / spacing) + 1) * spacing / length
    return np.stack([make_pose(place, yaw) for place in first + (last - first) * along[:, None]])


def measure_drive(scene: RayScene, sensor: Sensor, way: Drive, rng: np.random.Generator) -> Measurement:
    """Scan `scene` from the real poses and report the points where the robot believes them to be."""
    scan = measure(scene, sensor, way.poses, rng)
    return scan if way.believed is way.poses else scan.believed_at(way.believed)
