"""Point 4: a Ray cluster of two workers, one of them killed, against one worker and the local executor."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from benchmarks.sweeps.commands import SWEEPS, say, start_command, wait_for
from benchmarks.sweeps.rows import compared, span
from novelty.sweep import read_rows
from novelty.sweep.run import RunOptions, run_sweep
from novelty.sweep.sweep import load_sweep


def point_4(folder: Path, small: bool) -> None:
    """Ray: two workers against one, one of two killed, and the local executor."""
    changes = ["data.rooms.count=24"] if small else ["data.rooms.count=400"]
    sweep = load_sweep(SWEEPS / "scale.yaml", changes)
    seconds = {}
    for workers in (1, 2):
        summary = run_sweep(sweep, folder / f"ray{workers}", RunOptions(executor="ray", workers=workers))
        seconds[workers] = span(read_rows(folder / f"ray{workers}").to_pandas())
        say(f"Ray, {workers} workers: {summary.seconds:.0f} s, {seconds[workers]:.0f} s of work")
    say(f"two workers are {seconds[1] / seconds[2]:.2f} times as fast as one")
    process = start_command(folder / "lost", [*changes, "--executor", "ray", "--workers", "2"])
    victim = wait_for(lambda: ray_worker(process.pid))
    wait_for(lambda: len(list((folder / "lost" / "rows").glob("*.parquet"))) >= 1)
    os.kill(victim, signal.SIGKILL)
    process.wait()
    run_sweep(sweep, folder / "local", RunOptions())
    say(
        "one of two Ray workers killed, against the local executor: "
        + compared(folder / "lost", folder / "local")
    )


def ray_worker(parent: int) -> int | None:
    """The process of a Ray actor that was started below `parent` or in its session."""
    import psutil

    actors = [
        p.pid
        for p in psutil.Process(parent).children(recursive=True)
        if "ray::_Actor" in " ".join(p.cmdline())
    ]
    return actors[0] if actors else None
