"""The pairs that the accuracy tables score: real ones, simulated ones under disturbances, and scenes without change."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy_rows import Case
from novelty import InputError, Scan, ScanPair, read_pairs, read_scan
from novelty.simulation import simulate_pair
from novelty.simulation.poses import transform

FIRST_REPORTED = 100
"""Seeds below are for choosing parameters; reported figures use this one and above."""

SCENES = ("room", "corridor")
OBJECTS = {
    "room": ("person", "box", "cylinder", "move", "remove"),
    "corridor": ("person", "box", "cylinder", "door", "move"),
}
SIZED = ("box", "cylinder")
"""What can be made larger and smaller without becoming something else."""

PLAIN: dict[str, Any] = {"noise": 0.01}
UNDISTURBED = "none"
DISTURBANCES: dict[str, dict[str, Any]] = {
    UNDISTURBED: {},
    "pose 2 cm 0.5 deg": {"pose_error": (0.02, 0.5)},
    "pose 5 cm 1 deg": {"pose_error": (0.05, 1.0)},
    "pose 10 cm 2 deg": {"pose_error": (0.1, 2.0)},
    "viewpoint 0.5 m": {"viewpoint_shift": 0.5},
    "viewpoint 1.5 m": {"viewpoint_shift": 1.5},
    "viewpoint 3 m": {"viewpoint_shift": 3.0},
    "noise 0.5 cm": {"noise": 0.005},
    "noise 2 cm": {"noise": 0.02},
    "size 15 cm": {"object_size": 0.15},
    "size 30 cm": {"object_size": 0.3},
    "size 50 cm": {"object_size": 0.5},
    "density 0.25": {"density": 0.25},
    "density 4": {"density": 4.0},
    "16 lines": {"sensor": "vlp_16"},
    "16 lines 1 m": {"sensor": "vlp_16", "viewpoint_shift": 1.0},
}
"""Against a noise of 1 cm, one pose, one viewpoint, the usual sizes, and a turned planar scanner at its own density."""


def data_folder() -> Path | None:
    """The folder of real scans, None where there is none."""
    folder = Path(os.environ.get("NOVELTY_DATA", "../shared/data"))
    return folder if folder.is_dir() else None


def real_pairs(final: bool = False) -> Iterator[Case]:
    """The labelled table-top pairs: those for choosing parameters, and with `final` the others too."""
    folder = data_folder()
    for manifest in ("pairs-tune.csv", "pairs-check.csv")[: 2 if final else 1] if folder else ():
        condition = manifest.removesuffix(".csv").removeprefix("pairs-")
        for entry in read_pairs(folder / "mosd" / manifest):
            yield Case("mosd", condition, 0, entry.load())


def simulated(
    seeds: Sequence[int],
    conditions: Mapping[str, Mapping[str, Any]],
    objects: int,
    scenes: Iterable[str] = SCENES,
) -> Iterator[Case]:
    """One changed object per pair: in every scene, with every seed, `objects` kinds in turn, every condition."""
    for condition, options in conditions.items():
        for scene in scenes:
            for seed in seeds:
                for kind in _kinds(scene, seed, objects, "object_size" in options):
                    pair = _simulated_pair(scene, seed, (kind,), {**PLAIN, **options})
                    if pair is not None:
                        yield Case(scene, condition, seed, pair)


def twice(seeds: Sequence[int]) -> Iterator[Case]:
    """Simulated scenes in which nothing changed, seen from one place and from two."""
    for condition, shift in (("same pose", 0.0), ("viewpoint 1.5 m", 1.5)):
        for scene in SCENES:
            for seed in seeds:
                pair = _simulated_pair(scene, seed, (), {**PLAIN, "viewpoint_shift": shift})
                yield Case(scene, condition, seed, pair)


def split_halves(seeds: Sequence[int]) -> Iterator[Case]:
    """Real scans without their duplicates, halved at random: the same surfaces, sampled twice."""
    for file in _real_scans():
        scan = read_scan(file)
        points = scan.points[np.isfinite(scan.points).all(axis=1)]
        points = points[np.sort(np.unique(points, axis=0, return_index=True)[1])]
        for seed in seeds:
            half = np.random.default_rng(seed).random(len(points)) < 0.5
            halves = (Scan(points[side], origin=scan.origin, name=file.name) for side in (half, ~half))
            yield Case(f"{file.parent.name}/{file.name}", "random halves", seed, ScanPair(*halves, file.name))


def outdoor() -> Iterator[Case]:
    """The outdoor registration pair under its true pose; the sensors stood at the origins of their frames."""
    folder = data_folder()
    if folder is None:
        return
    source, target = (read_scan(folder / "lidar" / name).points for name in ("source.ply", "target.ply"))
    pose = np.loadtxt(folder / "lidar" / "T_target_source.txt")
    current = Scan(transform(pose, source), origin=pose[:3, 3], name="source")
    yield Case(
        "outdoor",
        "true pose",
        0,
        ScanPair(Scan(target, origin=np.zeros(3), name="target"), current, "outdoor"),
    )


def _real_scans() -> list[Path]:
    folder = data_folder()
    places = ("lidar", "kinect") if folder else ()
    return sorted(file for place in places for file in (folder / place).glob("*.p[lc][yd]"))


def _kinds(scene: str, seed: int, count: int, sized: bool) -> list[str]:
    kinds = SIZED if sized else OBJECTS[scene]
    return list(dict.fromkeys(kinds[(seed + turn) % len(kinds)] for turn in range(count)))


def _simulated_pair(
    scene: str, seed: int, changes: tuple[str, ...], options: dict[str, Any]
) -> ScanPair | None:
    """None where the scene of this seed has no room for the change."""
    try:
        scans = simulate_pair(scene, seed, changes, **options).scans
    except InputError:
        return None
    return ScanPair(scans.reference, scans.current, "-".join([scans.name, *changes]))
