"""Point 1: the sweep kmax.yaml against a loop of single `detect` calls in one warm process."""

from __future__ import annotations

import statistics
import time
from pathlib import Path
from typing import Any

import novelty
from benchmarks.sweeps.commands import SWEEPS, say
from benchmarks.sweeps.rows import kappas, stages
from novelty.sweep import read_rows
from novelty.sweep.run import RunOptions, make_plan, run_sweep
from novelty.sweep.settings import canonical_json, settings_of
from novelty.sweep.sources import pairs_of
from novelty.sweep.sweep import Sweep, load_sweep


def point_1(folder: Path, small: bool) -> None:
    """kmax.yaml against a loop."""
    changes = [
        "data.rooms.count=2",
        "data.corridors.count=2",
        "grid.max_components=[8,19,30]",
        "repetitions=2",
    ]
    sweep = load_sweep(SWEEPS / "kmax.yaml", changes if small else [])
    options = RunOptions()
    plan = make_plan(sweep, options)
    say(
        f"{len(plan.pairs)} pairs x {len(plan.settings)} settings = {plan.num_runs} runs in {len(plan.batches)} batches"
    )
    summary = run_sweep(sweep, folder / "kmax", options)
    say(
        f"sweep: {summary.seconds:.0f} s, {summary.seconds / summary.computed * 1e3:.0f} ms per run, "
        f"{summary.failed} failed"
    )
    each, agree = loop(sweep, folder / "kmax", 24 if small else 96)
    say(
        f"loop of detect: {each * 1e3:.0f} ms per run (median of a sample), "
        f"{each * plan.num_runs / 60:.0f} min for all of them"
    )
    say(f"ratio {each * plan.num_runs / summary.seconds:.1f}; {agree}")
    stages(folder / "kmax")


def loop(sweep: Sweep, root: Path, count: int) -> tuple[float, str]:
    """Seconds of a single `detect` in this process, simulation apart, over evenly chosen runs; how they agree."""
    rows = {(row["pair"], row["axes"], row["repetition"]): row for row in read_rows(root).to_pylist()}
    pairs, settings = pairs_of(sweep), settings_of(sweep)
    runs = [(pair, setting) for pair in pairs for setting in settings]
    chosen = runs[:: max(1, len(runs) // count)]
    loaded: dict[str, Any] = {}
    seconds, off = [], []
    novelty.detect(pairs[0].load(), settings[0].config)
    for pair, setting in chosen:
        scans = loaded.setdefault(pair.name, None) or pair.load()
        loaded = {pair.name: scans}
        start = time.perf_counter()
        result = novelty.detect(scans, setting.config)
        scores = kappas(scans, result.added.point_labels, result.removed.point_labels)
        seconds.append(time.perf_counter() - start)
        row = rows[pair.name, canonical_json(setting.axes), setting.repetition]
        off.append(abs(scores - row["kappa"]))
    return statistics.median(seconds), f"kappa of {len(off)} runs differs by {max(off):.1g} at most"
