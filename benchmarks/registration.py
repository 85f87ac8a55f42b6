"""How far registration is off, and how long it takes: `python -m benchmarks.registration [--seeds 3]`.

Simulated pairs with changes are misplaced by a known motion; so is the outdoor lidar pair, whose pose is known. The
camera of the mosd pairs stood still, so there the right correction is none. Real scans come from the folder
`NOVELTY_DATA` (default ../shared/data); their rows are left out, saying so, where it is not there. Only the method
is timed: reading, simulation and preprocessing stay outside, and the first pair is registered once to warm up.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from novelty.io.manifest import read_pairs
from novelty.io.reading import read_scan
from novelty.preprocess import PreparedPairs, Preprocess, prepare
from novelty.registration import Registration, Registrations, register
from novelty.scan import Scan, ScanPair
from novelty.simulation.pairs import simulate_pair
from novelty.simulation.poses import inverse, random_motion, transform

METHODS = ("none", "gicp", "mixture")
ERRORS = ((0.0, 0.0), (0.02, 0.5), (0.05, 1.0), (0.1, 2.0))
SCENES = {"room": ("person", "box"), "corridor": ("person", "box", "door"), "office": ("person", "move")}


@dataclass(frozen=True, eq=False)
class Case:
    """A pair and the motion (4, 4) that puts its current scan right, None where nobody knows."""

    name: str
    batch: PreparedPairs
    truth: np.ndarray | None


def misplaced(scan: Scan, error: tuple[float, float], seed: int) -> tuple[Scan, np.ndarray]:
    """The scan wrongly placed by (m, degrees) about its middle, and the motion that undoes it."""
    motion = random_motion(*error, np.random.default_rng(seed))
    centre = np.nanmean(scan.points, axis=0)
    motion[:3, 3] += centre - motion[:3, :3] @ centre
    origin = None if scan.origin is None else transform(motion, scan.origin)
    return Scan(transform(motion, scan.points), origin=origin, name=scan.name), inverse(motion)


def case(name: str, pair: ScanPair, error: tuple[float, float], seed: int, known: bool = True) -> Case:
    current, truth = misplaced(pair.current, error, seed)
    scans = prepare([pair.reference, current], Preprocess())
    batch = PreparedPairs(reference=scans.select([0]), current=scans.select([1]))
    return Case(f"{name}, {100 * error[0]:g} cm {error[1]:g} deg", batch, truth if known else None)


def simulated(seeds: int) -> Iterator[Case]:
    for scene, changes in SCENES.items():
        for seed in range(seeds):
            pair = simulate_pair(scene, seed, changes).scans
            yield from (case(scene, pair, error, seed) for error in ERRORS)


def real(folder: Path) -> Iterator[Case]:
    for entry in read_pairs(folder / "mosd" / "pairs-tune.csv"):
        pair = entry.load()
        yield from (case(f"mosd {entry.name}", pair, error, 0) for error in ERRORS[:3])
    source, target = (read_scan(folder / "lidar" / name) for name in ("source.ply", "target.ply"))
    pose = np.loadtxt(folder / "lidar" / "T_target_source.txt")
    pair = ScanPair(target, Scan(transform(pose, source.points)), "outdoor")
    for error in (*ERRORS, (0.5, 2.0)):
        yield case("outdoor lidar", pair, error, 0)
    rooms = [read_scan(folder / "lidar" / f"room_scan{number}.pcd") for number in (1, 2)]
    yield case("room_scan 1-2 as given", ScanPair(*rooms, "rooms"), (0.0, 0.0), 0, known=False)


def error_of(found: Registrations, case: Case) -> tuple[float, float]:
    """What is left of the misplacement: at the middle of the current scan, cm, and in degrees."""
    if case.truth is None:
        return np.nan, np.nan
    left = found.transforms[0].numpy() @ inverse(case.truth)
    centre = transform(case.truth, case.batch.current.points.points.mean(0).numpy())
    skew = left[:3, :3] - left[:3, :3].T
    angle = np.arcsin(min(1.0, np.linalg.norm(skew[[2, 0, 1], [1, 2, 0]]) / 2))
    return 100 * float(np.linalg.norm(transform(left, centre) - centre)), float(np.degrees(angle))


def row(case: Case, method: str) -> str:
    start = time.perf_counter()
    found = register(case.batch, Registration(method=method))
    seconds = time.perf_counter() - start
    shift, turn = error_of(found, case)
    return (
        f"{case.name:<38} {method:<8} {shift:8.3f} {turn:8.3f} {1e3 * float(found.residual[0]):8.1f} "
        f"{float(found.overlap[0]):6.0%} {int(found.observable[0]):3d} {found.status_of(0).name:<13} {seconds:7.3f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="simulated pairs per scene")
    parser.add_argument("--methods", nargs="+", default=METHODS, choices=METHODS)
    parser.add_argument("--only", choices=("simulated", "real"))
    options = parser.parse_args()
    torch.manual_seed(0)
    print(f"{torch.get_num_threads()} threads, torch {torch.__version__}; a row is one pair")
    print(
        f"{'pair, misplaced by':<38} {'method':<8} {'left cm':>8} {'left deg':>8} {'resid mm':>8} "
        f"{'overlap':>6} dof {'status':<13} {'seconds':>7}"
    )
    folder = Path(os.environ.get("NOVELTY_DATA", "../shared/data"))
    cases: list[Iterator[Case]] = [] if options.only == "real" else [simulated(options.seeds)]
    if options.only != "simulated":
        if folder.is_dir():
            cases.append(real(folder))
        else:
            print(f"no real scans: {folder} is not there; set NOVELTY_DATA")
    warm = False
    for each in (one for group in cases for one in group):
        for method in options.methods:
            if not warm:
                row(each, method)
            print(row(each, method), flush=True)
        warm = True


if __name__ == "__main__":
    main()
