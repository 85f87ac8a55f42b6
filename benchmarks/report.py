"""Time and size of the report of a sweep (`python -m benchmarks.report --rows 100000`).

The rows are drawn from a simple law, in the schema of a sweep; writing them is not timed.
"""

import argparse
import tempfile
import time
from pathlib import Path

from novelty.report.sweep import SweepRuns, write_sweep_page
from novelty.report.sweep.extremes import extremes
from novelty.sweep import SweepFolder
from tests.novelty.report.sweep_case import DETECTORS, keep_run, make_sweep

K_MAX = tuple(range(8, 31, 2))
REPETITIONS = 3


def keep_ends(folder: Path, num_points: int) -> None:
    """Keep labels and mixtures of the runs that the report draws: its file is then as large as it gets."""
    runs = SweepRuns.read(folder)
    for place, extreme in enumerate(extremes(runs)):
        row = {name: runs.table[name][extreme.row].as_py() for name in ("key", "inputs")}
        keep_run(SweepFolder(folder), row, place, num_points)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=100_000, help="runs of the sweep")
    parser.add_argument("--points", type=int, default=30_000, help="points of the scans that are drawn")
    arguments = parser.parse_args()
    pairs = -(-arguments.rows // (len(DETECTORS) * len(K_MAX) * REPETITIONS))
    with tempfile.TemporaryDirectory() as folder:
        rows = make_sweep(Path(folder), pairs=pairs, k_max=K_MAX, repetitions=REPETITIONS)
        keep_ends(Path(folder), arguments.points)
        report = Path(folder) / "report.html"
        start = time.perf_counter()
        runs = SweepRuns.read(folder)
        read = time.perf_counter()
        write_sweep_page(report, runs)
        done = time.perf_counter()
        print(f"{len(rows)} rows: {pairs} pairs, {len(DETECTORS)} detectors, {len(K_MAX)} values of K_max")
        print(f"read {read - start:.1f} s, build {done - read:.1f} s, together {done - start:.1f} s")
        print(f"{report.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
