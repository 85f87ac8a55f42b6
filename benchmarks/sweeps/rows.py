"""Pairs to sweep over, and what the rows of a sweep say: stages, span, scores, whether two sweeps agree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.dataset as ds

from benchmarks.sweeps.commands import say
from novelty.evaluation import evaluate_labels
from novelty.io import write_ply
from novelty.simulation import simulate_pair
from novelty.sweep import read_rows
from novelty.sweep.rows import EXACT, STAGES
from novelty.sweep.store import RUN


def written_pairs(folder: Path, count: int, points: int) -> Path:
    """Simulated rooms as labelled PLY files and their manifest."""

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


def stages(root: Path) -> None:
    """Time per stage, as a share."""
    rows = read_rows(root).to_pandas()
    means = {stage: rows[f"seconds_{stage}"].mean() for stage in STAGES}
    total = sum(means.values())
    say(
        "per run: "
        + ", ".join(f"{name} {value * 1e3:.0f} ms ({value / total:.0%})" for name, value in means.items())
    )


def span(rows: pd.DataFrame) -> float:
    """Seconds from the start of the first batch to the last row."""
    return (rows.finished.max() - rows.started.min()).total_seconds()


def kappas(scans, added, removed) -> float:
    """Mean kappa of both directions."""
    sides = ((scans.current, added), (scans.reference, removed))
    return float(np.nanmean([evaluate_labels(scan.labels, labels).scores.kappa for scan, labels in sides]))


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
