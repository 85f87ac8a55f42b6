"""`python -m benchmarks.sweeps [POINT ...]`: what sweeps cost and what they survive, five points in all.

1  the sweep kmax.yaml against a loop of single `detect` calls in one warm process
2  the whole pipeline on pairs of 60 000 points against one of scikit-learn, Open3D and POT
3  memory over many pairs; a sweep that is killed five times against one that is not
4  a Ray cluster of two workers, one of them killed, against one worker and against the local executor
5  a full disk, an unreadable scan, a scan that takes all memory, a damaged shard: what the user sees

`--small` makes every point a matter of a minute or two.
"""

from __future__ import annotations

import argparse
import os
import platform
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import yaml

import novelty
from benchmarks.peer_pipeline import VOXEL, PeerPipeline
from novelty.evaluation import evaluate_labels
from novelty.sweep import read_rows
from novelty.sweep.rows import EXACT, STAGES
from novelty.sweep.run import RunOptions, cores, make_plan, run_sweep
from novelty.sweep.settings import canonical_json, settings_of
from novelty.sweep.sources import SweepPair, pairs_of
from novelty.sweep.store import RUN
from novelty.sweep.sweep import Sweep, load_sweep

SWEEPS = Path(__file__).parents[1] / "configs" / "sweeps"
KILLS = 5


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


def point_5(folder: Path, small: bool) -> None:
    """What goes wrong, and what the user sees."""
    manifest = written_pairs(folder / "scans", 3, 5_000)
    lines = manifest.read_text().splitlines()
    (folder / "scans" / "torn.ply").write_bytes((folder / "scans" / "0-reference.ply").read_bytes()[:3000])
    huge = np.lib.format.open_memmap(
        folder / "scans" / "huge.npy", mode="w+", dtype="f4", shape=(60_000_000, 3)
    )
    huge[:: len(huge) // 1000] = np.random.default_rng(0).normal(size=huge[:: len(huge) // 1000].shape)
    del huge
    lines += ["torn,torn.ply,0-current.ply,,", "huge,huge.npy,0-current.ply,,"]
    manifest.write_text("\n".join(lines))
    file = folder / "faults.yaml"
    file.write_text(
        yaml.safe_dump({"data": {"files": {"pairs": str(manifest)}}, "grid": {"max_components": [5, 10]}})
    )
    say("--- an unreadable scan, and one that takes all memory (budget 3 GB for two workers)")
    show_command(file, folder / "faults", "--memory", "3GB")
    rows = read_rows(folder / "faults").to_pandas()
    for row in rows[rows.status.isin(["failed", "out of memory"])].drop_duplicates("pair").itertuples():
        say(f"row of {row.pair}: {row.status}: {row.message[:150]}")
    say("--- a damaged shard")
    shard = sorted((folder / "faults" / "rows").iterdir())[0]
    shard.write_bytes(shard.read_bytes()[:2000])
    show_command(file, folder / "faults", "--memory", "3GB")
    say("--- a disk that fills up")
    with full_disk(folder / "disk", "150k") as disk:
        if disk is None:
            say("skipped: mounting a small disk needs root")
            return
        small_sweep = SWEEPS / "scale.yaml"
        show_command(small_sweep, disk / "out", "data.rooms.count=96", "grid.max_components=[5,10]")
        safe = len(read_rows(disk / "out"))
        subprocess.run(["mount", "-o", "remount,size=100m", str(disk)], check=True)
        say(f"{safe} rows are safe; after making room:")
        show_command(small_sweep, disk / "out", "data.rooms.count=96", "grid.max_components=[5,10]")
        say(f"{len(read_rows(disk / 'out'))} rows")


POINTS: dict[int, Callable[[Path, bool], None]] = {
    1: point_1, 2: point_2, 3: point_3, 4: point_4, 5: point_5,
}  # fmt: skip


def stages(root: Path) -> None:
    """Time per stage, as a share."""
    rows = read_rows(root).to_pandas()
    means = {stage: rows[f"seconds_{stage}"].mean() for stage in STAGES}
    total = sum(means.values())
    say(
        "per run: "
        + ", ".join(f"{name} {value * 1e3:.0f} ms ({value / total:.0%})" for name, value in means.items())
    )


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


def rows_in(root: Path) -> int:
    """Rows in the shards of a folder, read or not."""
    return sum(pq.read_metadata(shard).num_rows for shard in (root / "rows").glob("[!.]*.parquet"))


def compared(one: Path, other: Path) -> str:
    """Whether two folders hold the same rows, and every row once."""
    tables = [
        read_rows(root).to_pandas().sort_values(list(RUN)).reset_index(drop=True) for root in (one, other)
    ]
    left, right = (table[[column for column in EXACT if column != "key"]] for table in tables)
    paths = ["reference_mdl_path", "current_mdl_path"]
    flat = [table.drop(columns=paths) for table in (left, right)]
    exact = (
        flat[0].equals(flat[1])
        and all(
            np.array_equal(a, b, equal_nan=True)
            for path in paths
            for a, b in zip(left[path], right[path], strict=True)
        )
        if len(left) == len(right)
        else False
    )
    numbers = flat[0].select_dtypes("float").columns
    close = len(left) == len(right) and np.allclose(
        flat[0][numbers], flat[1][numbers], rtol=1e-6, equal_nan=True
    )
    same = (
        "identical to the last bit"
        if exact
        else "identical but for rounding (1e-6)"
        if close
        else "DIFFERENT"
    )
    keys = ds.dataset(one / "rows", format="parquet").to_table(columns=["key"])["key"]
    twice = len(keys) - len(keys.unique())
    return f"{len(left)} rows against {len(right)}, {twice} in the shards twice, {same}"


def written_pairs(folder: Path, count: int, points: int) -> Path:
    """Simulated rooms as labelled PLY files and their manifest."""
    from novelty.io import write_ply
    from novelty.simulation import simulate_pair

    folder.mkdir(parents=True, exist_ok=True)
    lines = ["name,reference,current,reference_origin,current_origin"]
    for seed in range(100, 100 + count):
        pair = simulate_pair("room", seed, ("person", "box"), noise=0.01, density=points / 96_500).scans
        files = []
        for role, scan in (("reference", pair.reference), ("current", pair.current)):
            write_ply(folder / f"{seed - 100}-{role}.ply", scan.points, label=scan.labels)
            files.append(f"{seed - 100}-{role}.ply")
        origins = [" ".join(map(str, scan.origin)) for scan in (pair.reference, pair.current)]
        lines.append(",".join([f"room-{seed}", *files, *origins]))
    (folder / "pairs.csv").write_text("\n".join(lines))
    return folder / "pairs.csv"


def kappas(scans, added, removed) -> float:
    """Mean kappa of both directions."""
    sides = ((scans.current, added), (scans.reference, removed))
    return float(np.nanmean([evaluate_labels(scan.labels, labels).scores.kappa for scan, labels in sides]))


def span(rows: pd.DataFrame) -> float:
    """Seconds from the start of the first batch to the last row."""
    return (rows.finished.max() - rows.started.min()).total_seconds()


def command(file: Path | str, out: Path, *rest: str) -> list[str]:
    return [
        sys.executable,
        "-c",
        "from novelty.cli import main; main()",
        "sweep",
        str(file),
        "--out",
        str(out),
        *rest,
    ]


def start_command(out: Path, rest: list[str]) -> subprocess.Popen:
    """scale.yaml in a process group of its own, so that a kill takes its workers too."""
    with (out.parent / f"{out.name}.log").open("a") as log:
        return subprocess.Popen(
            command(SWEEPS / "scale.yaml", out, *rest), start_new_session=True, stdout=log, stderr=log
        )


def run_command(out: Path, rest: list[str]) -> None:
    if start_command(out, rest).wait() not in (0, 1):
        raise SystemExit((out.parent / f"{out.name}.log").read_text())


def show_command(file: Path | str, out: Path, *rest: str) -> None:
    """Run a sweep and show what the user sees."""
    done = subprocess.run(command(file, out, *rest), capture_output=True, text=True, check=False)
    for line in (done.stdout + done.stderr).splitlines():
        say(f"  | {line}")
    say(f"  | exit code {done.returncode}")


def ray_worker(parent: int) -> int | None:
    """The process of a Ray actor that was started below `parent` or in its session."""
    import psutil

    actors = [
        p.pid
        for p in psutil.Process(parent).children(recursive=True)
        if "ray::_Actor" in " ".join(p.cmdline())
    ]
    return actors[0] if actors else None


def wait_for(condition: Callable[[], Any], seconds: float = 120.0) -> Any:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if found := condition():
            return found
        time.sleep(0.05)
    raise TimeoutError("nothing happened")


class full_disk:  # noqa: N801
    """A file system of its own of so many bytes; None where that needs rights that one does not have."""

    def __init__(self, place: Path, size: str) -> None:
        self.place, self.size = place, size

    def __enter__(self) -> Path | None:
        self.place.mkdir(parents=True)
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={self.size}", "tmpfs", str(self.place)],
            capture_output=True,
            check=False,
        )
        self.mounted = done.returncode == 0
        return self.place if self.mounted else None

    def __exit__(self, *_: object) -> None:
        if self.mounted:
            subprocess.run(["umount", str(self.place)], check=True)


def say(line: str) -> None:
    print(line, flush=True)


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
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
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
