"""The command: `python -m benchmarks.sweeps [POINT ...] [--small]`."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import benchmarks.sweeps
import novelty
from benchmarks.sweeps.against_loop import point_1
from benchmarks.sweeps.against_peer import point_2
from benchmarks.sweeps.cluster import point_4
from benchmarks.sweeps.commands import say
from benchmarks.sweeps.faults import point_5
from benchmarks.sweeps.survival import point_3
from novelty.sweep.run import cores

POINTS: dict[int, Callable[[Path, bool], None]] = {
    1: point_1, 2: point_2, 3: point_3, 4: point_4, 5: point_5,
}  # fmt: skip


def conditions() -> str:
    """On what the figures were measured."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
    )
    return (
        f"{platform.processor() or platform.machine()}, {cores()} cores, load {os.getloadavg()[0]:.1f}, "
        f"novelty {novelty.__version__} {commit.stdout.strip()}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=benchmarks.sweeps.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "points", type=int, nargs="*", choices=list(POINTS), metavar="POINT", help="1 to 5; all by default"
    )
    parser.add_argument("--small", action="store_true", help="a minute or two each")
    arguments = parser.parse_args()
    say(conditions())
    for point in arguments.points or POINTS:
        root = Path(tempfile.mkdtemp(prefix="novelty-sweeps-"))
        say(f"\n== {point}. {POINTS[point].__doc__}")
        start = time.perf_counter()
        try:
            POINTS[point](root, arguments.small)
        finally:
            shutil.rmtree(root, ignore_errors=True)
        say(f"({time.perf_counter() - start:.0f} s)")


if __name__ == "__main__":
    main()
