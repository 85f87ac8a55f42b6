"""How well changes are found: `python -m benchmarks.accuracy [--table mosd ...] [--seeds 10] [--report]`.

Seven tables: real pairs, baselines, disturbances, false alarms, order and seed, throughput of the comparison,
ablation. Parameters are chosen on seeds below 100 and the pairs for tuning; `--report` takes seeds from 100 on, and
`--final` scores the real pairs that are kept for the last table. Real scans come from the folder `NOVELTY_DATA`
(default ../shared/data). Every pair of every table becomes a row of `OUT/<table>.csv`.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

import torch

from benchmarks.accuracy_cases import DISTURBANCES, FIRST_REPORTED, data_folder
from benchmarks.accuracy_rows import Stopwatch
from benchmarks.accuracy_tables import TABLES, Options, console, default_detectors
from novelty.config import detector_names
from novelty.environment import machine, versions


def main() -> None:
    """Print the tables asked for and write their rows."""
    given = _arguments()
    first = FIRST_REPORTED if given.report else 0
    options = Options(
        seeds=range(first, first + given.seeds),
        objects=given.objects,
        detectors=given.detector or default_detectors(),
        batch=given.batch,
        workers=given.workers,
        final=given.final,
        conditions=given.condition or list(DISTURBANCES),
        file=given.out,
    )
    known = versions()
    console.print(
        f"novelty {known['novelty']}, torch {known['torch']}, {torch.get_num_threads()} threads of "
        f"{machine()['cpu_count']}; seeds {options.seeds[0]} to {options.seeds[-1]}"
    )
    if data_folder() is None:
        console.print("no real scans: set NOVELTY_DATA to the folder that holds them")
    for name in given.table or TABLES:
        watch = Stopwatch()
        file = given.out / f"{name}.csv"
        rows = TABLES[name](replace(options, file=file))
        for row in rows:
            if row.failure:
                console.print(
                    f"   failed: {row.variant} on {row.data} {row.pair}: {row.failure}", markup=False
                )
        console.print(f"   {file}: {len(rows)} rows, {watch.seconds:.0f} s\n")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="append", choices=list(TABLES), help="repeatable; all by default")
    parser.add_argument("--seeds", type=int, default=10, help="simulated scenes per condition (10)")
    parser.add_argument("--objects", type=int, default=5, help="changed objects per scene, one pair each (5)")
    parser.add_argument(
        "--detector", action="append", choices=detector_names(), help="repeatable; all by default"
    )
    parser.add_argument(
        "--condition", action="append", choices=list(DISTURBANCES), help="repeatable; all by default"
    )
    parser.add_argument("--batch", type=int, default=8, help="pairs fitted together (8)")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes (one per core)")
    parser.add_argument("--report", action="store_true", help="seeds from 100 on, which nothing was tuned on")
    parser.add_argument(
        "--final", action="store_true", help="score the pairs kept for the final table as well"
    )
    parser.add_argument("--out", type=Path, default=Path("accuracy-output"), help="folder of the rows")
    return parser.parse_args()


if __name__ == "__main__":
    main()
