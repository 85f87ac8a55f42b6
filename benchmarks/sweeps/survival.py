"""Point 3: memory over many pairs; a sweep that is killed five times against one that is not."""

from __future__ import annotations

import os
import random
import signal
import time
from pathlib import Path

import numpy as np

from benchmarks.sweeps.commands import rows_in, run_command, say, start_command, wait_for
from benchmarks.sweeps.rows import compared
from novelty.sweep import read_rows

KILLS = 5


def point_3(folder: Path, small: bool) -> None:
    """Memory over many pairs, and five kills."""
    count = 60 if small else 2000
    changes = [f"data.rooms.count={count}"]
    whole, killed = folder / "whole", folder / "killed"
    start = time.perf_counter()
    run_command(whole, changes)
    seconds = time.perf_counter() - start
    say(f"{count} pairs undisturbed: {seconds:.0f} s")
    memory(whole, 20 if small else 100)
    for kill in range(KILLS):
        process, before = start_command(killed, changes), rows_in(killed)
        wait_for(lambda: process.poll() is not None or rows_in(killed) > before)  # noqa: B023
        time.sleep(random.Random(kill).uniform(0, seconds / 2 / KILLS))
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        say(f"kill {kill + 1}: {rows_in(killed)} rows are safe")
    run_command(killed, changes)
    say(compared(killed, whole))


def memory(root: Path, first: int) -> None:
    """Resident memory of every worker from the first pairs to the last."""
    rows = read_rows(root).to_pandas().sort_values("finished")
    later = rows.iloc[first:]
    for worker, own in later.groupby("worker"):
        ends = own.memory.iloc[0] / 1e6, own.memory.iloc[-1] / 1e6
        slope = np.polyfit(np.arange(len(own)), own.memory / 1e6, 1)[0] * 1000 if len(own) > 1 else np.nan
        say(
            f"memory of {worker} from pair {first} on: {ends[0]:.0f} MB at first, "
            f"{own.memory.max() / 1e6:.0f} MB at most, {ends[1]:.0f} MB at last, {slope:+.0f} MB per 1000 pairs"
        )
