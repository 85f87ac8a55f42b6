"""Pairs of simulated scans: one place before and after something changed, with ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from novelty.errors import InputError
from novelty.scan import ScanPair
from novelty.simulation.changes import apply_changes
from novelty.simulation.drive import Drive, drive, measure_drive
from novelty.simulation.measure import as_poses
from novelty.simulation.poses import FloatArray, random_motion
from novelty.simulation.raycast import RayScene
from novelty.simulation.sampling import sample_world
from novelty.simulation.scenes import Scene, make_scene
from novelty.simulation.sensors import PushBroom, Sensor, get_sensor
from novelty.simulation.simulated import SimulatedPair, pair_samples, pair_up
from novelty.simulation.world import World

ROBOT_SENSOR_HEIGHT = 0.3
"""Height of the laser of a driving robot above the floor, m: on the deck of a Pioneer 3-AT."""

STAND_OFF = 0.15
"""Least distance of a sensor from every surface where it stands, m."""


class PairOptions(TypedDict, total=False):
    """Options common to all pairs.

    Attributes:
        sensor: A sensor or its name in `SENSORS`; `utm_30lx`.
        noise: Standard deviation of constant range noise, m, instead of the sensor's own.
        density: Factor on the number of rays; 1.
        origins: Positions (3,) or poses (4, 4) of the sensor in the reference and in the current scan,
            each one or several; the scene's viewpoint.
        viewpoint_shift: How far the sensor moves between the scans, m; 0. Sideways and ahead, or another way where
            something stands there.
        pose_error: Wrong placement of the current scan: shift (m) and turn (degrees); (0, 0).
        object_size: Of new objects, m (height of a person or box, diameter of a cylinder).
        reverse: Whether the changed world is scanned first, so that what was added is then removed; False.
        drift: Error of the localisation of a sensor that scans while it drives, see `drive`; (0, 0).
        mounting: Roll and pitch of such a sensor that the localisation does not know of, degrees; (0, 0).
        name: Of the pair; the scene and the seed.
    """

    sensor: str | Sensor
    noise: float | None
    density: float
    origins: tuple[ArrayLike, ArrayLike] | None
    viewpoint_shift: float
    pose_error: tuple[float, float]
    object_size: float | None
    reverse: bool
    drift: tuple[float, float]
    mounting: tuple[float, float]
    name: str


def demo_pair(seed: int = 0) -> ScanPair:
    """A furnished corridor before and after a person, a box and an opened door appear; 1 cm noise."""
    return corridor_pair(seed, noise=0.01)


def corridor_pair(
    seed: int = 0, changes: Sequence[str] = ("person", "box", "door"), **options: Unpack[PairOptions]
) -> ScanPair:
    """A corridor before and after `changes` (names in `CHANGES`; none: the same world measured twice)."""
    return simulate_pair("corridor", seed, changes, **options).scans


def room_pair(
    seed: int = 0, changes: Sequence[str] = ("person", "box"), **options: Unpack[PairOptions]
) -> ScanPair:
    """A living room before and after `changes` (names in `CHANGES`; none: the same world measured twice)."""
    return simulate_pair("room", seed, changes, **options).scans


def office_pair(
    seed: int = 0, changes: Sequence[str] = ("person", "move"), **options: Unpack[PairOptions]
) -> ScanPair:
    """An office before and after `changes` (names in `CHANGES`; none: the same world measured twice)."""
    return simulate_pair("office", seed, changes, **options).scans


def simulate_pair(
    scene: str | Scene, seed: int = 0, changes: Sequence[str] = (), **options: Unpack[PairOptions]
) -> SimulatedPair:
    """Scan a scene, change it, scan it again. A sensor that scans while it drives follows the scene's path.

    Args:
        scene: A scene, or the name of a generator in `SCENES`, which is called with `seed`.
        seed: The same seed gives the same bytes. Layout, changes, noise of either scan and pose error have
            streams of their own, so that one option does not disturb the others.
        changes: Names in `CHANGES`.
        **options: See `PairOptions`.

    Raises:
        InputError: An unknown scene, sensor or change, a sensor that scans only while it drives in a scene without
            path, or no room for a new object.
    """
    place = make_scene(scene, seed) if isinstance(scene, str) else scene
    changing, moving, first, second, erring, *drifting = [
        np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(7)
    ]
    sensor = _sensor(options)
    if isinstance(sensor.pattern, PushBroom):
        place = place.with_free_path()
    before, after = _worlds(
        place, changes, changing, options.get("object_size"), options.get("reverse", False)
    )
    unchanged, changed = RayScene(before), RayScene(after)
    ways = _ways(place, (unchanged, changed), sensor, options, moving, drifting)
    reference = measure_drive(unchanged, sensor, ways[0], first)
    current = measure_drive(changed, sensor, ways[1], second)
    error = _about(ways[1].poses[0, :3, 3], random_motion(*options.get("pose_error", (0.0, 0.0)), erring))
    misplaced = current.believed_at(error @ current.believed)
    return pair_up(reference, misplaced, options.get("name", f"{place.name}-{seed}"))


def sample_pair(
    scene: str | Scene,
    seed: int = 0,
    changes: Sequence[str] = (),
    *,
    density: float = 1000.0,
    noise: float = 0.01,
    object_size: float | None = None,
    reverse: bool = False,
    name: str | None = None,
) -> SimulatedPair:
    """Draw points evenly from the surfaces of a scene, change it, draw again: no sensor, nothing hidden.

    Args:
        scene: As in `simulate_pair`.
        seed: As in `simulate_pair`.
        changes: Names in `CHANGES`.
        density: Points per square metre.
        noise: Standard deviation of white noise per axis, m.
        object_size: As in `PairOptions`.
        reverse: As in `PairOptions`.
        name: Of the pair; the scene and the seed when None.

    Raises:
        InputError: An unknown scene or change, or no room for a new object.
    """
    place = make_scene(scene, seed) if isinstance(scene, str) else scene
    changing, first, second = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    worlds = _worlds(place, changes, changing, object_size, reverse)
    samples = [
        sample_world(world, density, noise, rng) for world, rng in zip(worlds, (first, second), strict=True)
    ]
    return pair_samples(samples[0], samples[1], name or f"{place.name}-{seed}")


def _worlds(
    scene: Scene, changes: Sequence[str], rng: np.random.Generator, size: float | None, reverse: bool
) -> tuple[World, World]:
    """The world of the reference and that of the current scan."""
    changed = apply_changes(scene, tuple(changes), rng, size)
    return (changed, scene.world) if reverse else (scene.world, changed)


def _sensor(options: PairOptions) -> Sensor:
    sensor = get_sensor(options.get("sensor", "utm_30lx")).with_density(options.get("density", 1.0))
    noise = options.get("noise")
    return sensor if noise is None else sensor.with_noise(noise)


def _ways(
    scene: Scene,
    worlds: Sequence[RayScene],
    sensor: Sensor,
    options: PairOptions,
    rng: np.random.Generator,
    drifting: Sequence[np.random.Generator],
) -> tuple[Drive, Drive]:
    """Where the sensor was in the reference and in the current scan."""
    if scene.path is None or not isinstance(sensor.pattern, PushBroom):
        standing = _poses(scene, worlds, options, rng)
        return Drive(standing[0], standing[0]), Drive(standing[1], standing[1])
    places = np.column_stack([scene.path, np.full(len(scene.path), ROBOT_SENSOR_HEIGHT)])
    spacing, mounting = sensor.pattern.spacing, options.get("mounting", (0.0, 0.0))
    drift = options.get("drift", (0.0, 0.0))
    there, again = (
        drive(*places, spacing=spacing, drift=drift, mounting=mounting, rng=rng) for rng in drifting
    )
    return there, again


def _poses(
    scene: Scene, worlds: Sequence[RayScene], options: PairOptions, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Poses (S, 4, 4) of the sensor in the reference and in the current scan."""
    origins = options.get("origins")
    angle = rng.uniform(-np.pi / 4, np.pi / 4)
    if origins is not None:
        return as_poses(origins[0]), as_poses(origins[1])
    shifted = scene.viewpoint.copy()
    shift = options.get("viewpoint_shift", 0.0)
    if shift:
        shifted[:3, 3] = _place_aside(scene, worlds, shift, angle)
    return scene.viewpoint[None], shifted[None]


def _place_aside(scene: Scene, worlds: Sequence[RayScene], shift: float, angle: float) -> FloatArray:
    """Where the sensor stands free (3,), `shift` metres from its first place as nearly towards `angle` as may be.

    Less where the floor ends before. Free is what keeps `STAND_OFF` from every surface and is not inside a body, in
    all `worlds`.

    Raises:
        InputError: There is no such place.
    """
    first = scene.viewpoint[:3, 3]
    angles = angle + np.radians([0, *(sign * turn for turn in range(15, 181, 15) for sign in (1, -1))])
    places = np.repeat(first[None], len(angles), axis=0)
    places[:, :2] += shift * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    places[:, :2] = np.clip(places[:, :2], *scene.floor)
    outside = [world.crossings(first, places) % 2 == 0 for world in worlds]
    apart = [world.distance(places) >= STAND_OFF for world in worlds]
    free = np.all([*outside, *apart], axis=0)
    if not free.any():
        raise InputError(
            f"no free place for the sensor {shift:g} m from its viewpoint in scene {scene.name!r}; "
            "give a smaller viewpoint_shift, or the places themselves as origins"
        )
    return places[np.argmax(free)]


def _about(centre: FloatArray, motion: FloatArray) -> FloatArray:
    """A rigid motion (4, 4) that turns about `centre` (3,) instead of the origin."""
    result = motion.copy()
    result[:3, 3] += centre - motion[:3, :3] @ centre
    return result
