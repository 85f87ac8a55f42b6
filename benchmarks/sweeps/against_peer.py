"""Point 2: the whole pipeline from files against one of scikit-learn, Open3D and POT."""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import numpy as np

from benchmarks.sweeps.commands import say
from benchmarks.sweeps.peer_pipeline import VOXEL, PeerPipeline
from benchmarks.sweeps.rows import kappas, span, stages, written_pairs
from novelty.sweep import read_rows
from novelty.sweep.run import RunOptions, run_sweep
from novelty.sweep.sources import SweepPair, pairs_of
from novelty.sweep.sweep import Sweep


def point_2(folder: Path, small: bool) -> None:
    """The whole pipeline against its peer, from files."""
    count, points = (4, 20_000) if small else (64, 60_000)
    manifest = written_pairs(folder / "scans", count, points)
    sweep = Sweep.from_mapping(
        {"data": {"files": {"pairs": str(manifest)}}, "configuration": {"max_components": 20}}
    )
    summary = run_sweep(sweep, folder / "pipeline", RunOptions())
    rows = read_rows(folder / "pipeline").to_pandas()
    busy = span(rows)
    say(
        f"ours: {count} pairs of {points} points in {summary.seconds:.1f} s with starting the workers, "
        f"{busy:.1f} s of work"
    )
    say(
        f"      {count / summary.seconds:.2f} pairs/s ({count / busy:.2f} without the start), "
        f"kappa {rows.kappa.mean():.3f}"
    )
    stages(folder / "pipeline")
    pairs = pairs_of(sweep)
    for voxel, trials in ((VOXEL, 2 if small else 8), (None, 1 if small else 2)):
        seconds, kappa = peer(pairs[:trials], voxel, 20)
        ours = rows[rows.pair.isin([pair.name for pair in pairs[:trials]])].kappa.mean()
        name = "all points" if voxel is None else f"voxels of {voxel} m"
        say(
            f"peer, {name}: {seconds:.1f} s per pair over {trials} pairs, kappa {kappa:.3f} (ours there {ours:.3f}); "
            f"ratio {seconds / (summary.seconds / count):.0f} ({seconds / (busy / count):.0f} without the start)"
        )


def peer(pairs: tuple[SweepPair, ...], voxel: float | None, max_components: int) -> tuple[float, float]:
    """Seconds per pair of the peer, reading included, and its mean kappa."""
    seconds, scores = [], []
    for pair in pairs:
        start = time.perf_counter()
        scans = pair.load()
        answer = PeerPipeline(max_components, voxel)(scans)
        seconds.append(time.perf_counter() - start)
        scores.append(kappas(scans, answer.added, answer.removed))
    return statistics.mean(seconds), float(np.nanmean(scores))
