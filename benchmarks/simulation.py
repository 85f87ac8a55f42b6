"""`python -m benchmarks.simulation`: how fast scans are simulated, and how many points each platform delivers.

Three tables. Rays: the full sensor model (casting, range noise, mixed pixels, lost returns, shadows) in million rays
per second of processor time of one core. Pairs: two labelled scans of about 60 000 points together, scene and changes
included. Both the best of several runs, after one warm-up. Experiments: points of the first pair of every case.
`--out DIR` writes what the sensors' figures are checked by: see `benchmarks.simulation_figures`.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.simulation_figures import write_figures
from novelty.scan import CHANGED
from novelty.simulation import (
    SENSORS,
    Measurement,
    RayScene,
    experiment_names,
    get_sensor,
    load_experiment,
    make_scene,
    measure,
    simulate_pair,
)

RAYS = 1_000_000
PAIRS = {  # density that makes two scans of 30 000 points
    "urg_04lx": ("corridor", 0.72),
    "utm_30lx": ("office", 0.32),
    "lms_200": ("corridor", 0.18),
    "vlp_16": ("hall", 1.05),
    "hdl_32e": ("hall", 0.5),
    "kinect": ("room", 0.2),
}


@dataclass(frozen=True)
class Timing:
    """What one call made, and the least processor time that it took, s."""

    made: object
    seconds: float


def fastest(run: Callable[[], object], runs: int) -> Timing:
    """The best of several runs after a warm-up; processor time, so that a busy machine does not count."""
    made, seconds = run(), []
    for _ in range(runs):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return Timing(made, min(seconds))


def rays_table(runs: int) -> None:
    print(f"{'sensor':<10} {'rays':>9} {'returns':>9} {'Mrays/s/core':>13}")
    scene = make_scene("office", 100)
    world = RayScene(scene.world)
    for name in SENSORS:
        sensor = get_sensor(name)
        grid = sensor.pattern.directions()[..., 0].size
        poses = scene.viewpoint[None]
        if name == "lms_200":  # its density is the number of poses
            poses = np.repeat(poses, RAYS // grid, axis=0)
        else:
            sensor = sensor.with_density(RAYS / grid)
        rays = sensor.pattern.directions()[..., 0].size * len(poses)
        timing = fastest(lambda s=sensor, p=poses: measure(world, s, p, np.random.default_rng(0)), runs)
        assert isinstance(timing.made, Measurement)
        print(f"{name:<10} {rays:>9} {len(timing.made.points):>9} {rays / timing.seconds / 1e6:>13.2f}")


def pairs_table(runs: int) -> None:
    print(f"\n{'labelled pair':<20} {'points':>9} {'seconds':>8}")
    for sensor, (scene, density) in PAIRS.items():
        timing = fastest(
            lambda at=(scene, sensor, density): (
                simulate_pair(at[0], 100, ("person",), sensor=at[1], density=at[2]).scans
            ),
            runs,
        )
        points = timing.made.reference.num_points + timing.made.current.num_points  # type: ignore[attr-defined]
        print(f"{scene + ', ' + sensor:<20} {points:>9} {timing.seconds:>8.3f}")


def counts_table() -> None:
    print(f"\n{'experiment':<18} {'case':<14} {'points':>8} {'gone':>6} {'new':>6}")
    for name in experiment_names():
        seen = set()
        for pair in load_experiment(name).pairs():
            if pair.case.name in seen:
                continue
            seen.add(pair.case.name)
            scans = pair.simulate().scans
            gone, new = (int((scan.labels == CHANGED).sum()) for scan in (scans.reference, scans.current))
            print(f"{name:<18} {pair.case.name:<14} {scans.current.num_points:>8} {gone:>6} {new:>6}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5, help="timed runs of each line")
    parser.add_argument("--out", type=Path, help="folder for the histograms and pictures")
    arguments = parser.parse_args()
    print(
        f"{platform.processor() or platform.machine()}, Python {platform.python_version()}; processor time, best run"
    )
    rays_table(arguments.runs)
    pairs_table(arguments.runs)
    counts_table()
    if arguments.out:
        write_figures(arguments.out)


if __name__ == "__main__":
    main()
