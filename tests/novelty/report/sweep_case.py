"""A sweep's folder as `novelty sweep` would leave it, drawn from a simple law: tests and benchmarks read it."""

from __future__ import annotations

import itertools
import json
from datetime import UTC, datetime, timedelta

import numpy as np

from novelty.config import Config
from novelty.sweep import SweepFolder
from novelty.sweep.rows import COUNTS, DIRECTIONS, METRICS, ROLES, STAGES
from novelty.sweep.store import RowStore
from tests.novelty.report_case import make_pair, make_result

DETECTORS = ("greedy_emd", "joint_mixture", "likelihood", "structural_matching")
SKILL = dict(zip(DETECTORS, (0.62, 0.93, 0.9, 0.71), strict=True))
START = datetime(2026, 3, 1, 9, 0, tzinfo=UTC)
SHARE_OF_TIME = dict(zip(STAGES, (0.05, 0.4, 0.05, 0.35, 0.05, 0.05, 0.05), strict=True))
OUT_OF_POINTS = (
    "pairs.csv, line 7: scan_7.pcd: the file is cut short: its header announces 100 points, 7 follow."
)


def make_sweep(
    root,
    *,
    pairs=6,
    detectors=DETECTORS,
    k_max=(8, 12, 20),
    repetitions=2,
    axes=None,
    conditions=({},),
    skill=0.0,
    failing=(),
    keep=(),
    seed=0,
    shard=2000,
    labelled=True,
):
    """Write rows for every pair, detector, K_max, further axis, condition and repetition.

    Args:
        root: The folder.
        pairs: Number of pairs.
        detectors: Their names.
        k_max: Values of `max_components`.
        repetitions: Number of repetitions.
        axes: Further configuration keys and their values.
        conditions: Options of the simulation.
        skill: Added to the mean kappa of every detector.
        failing: Numbers of the pairs whose runs fail.
        keep: Numbers of the pairs whose labels and mixtures are kept.
        seed: Of the draws.
        shard: Rows per shard.
        labelled: Whether there are scores at all.

    Returns:
        The rows, as mappings.
    """
    rng = np.random.default_rng(seed)
    folder, rows = SweepFolder(root), []
    store = RowStore(folder)
    axes = axes or {}
    grid = itertools.product(
        range(pairs), detectors, k_max, range(repetitions), conditions, itertools.product(*axes.values())
    )
    difficulty = rng.normal(0, 0.04, pairs)
    configuration = Config().to_mapping()
    for place, (pair, detector, most, repetition, condition, more) in enumerate(grid):
        values = dict(zip(axes, more, strict=True))
        row = _row(rng, place, pair, detector, most, repetition, condition, values, difficulty[pair] + skill)
        row["configuration"] = json.dumps(
            configuration | {"detector": detector, "max_components": most} | values
        )
        if not labelled:
            row |= {key: None for key in row if key.split("_", 1)[-1] in METRICS or key in METRICS}
        if pair in failing:
            row = _failed(row)
        elif pair in keep:
            keep_run(folder, row, pair)
        rows.append(row)
    for start in range(0, len(rows), shard):
        store.write(rows[start : start + shard])
    folder.sweep_file.write_text(
        "name: kmax\ndata:\n  corridor: {simulate: corridor}\ngrid:\n  max_components: [8, 12, 20]\n"
    )
    return rows


def _row(rng, place, pair, detector, most, repetition, condition, axes, shift):
    level = SKILL[detector] + shift - 0.002 * abs(most - 16) - 0.3 * condition.get("pose_error", 0)
    scores = {d: float(np.clip(level + rng.normal(0, 0.05), 0, 1)) for d in DIRECTIONS}
    seconds = {stage: float(share * rng.gamma(8, 0.05)) for stage, share in SHARE_OF_TIME.items()}
    order = int(np.clip(rng.integers(6, 14), 1, most))
    started = START + timedelta(seconds=0.4 * (place // 100) * 100)
    row = {
        "key": f"{place:016x}",
        "data": "corridor",
        "pair": "-".join([f"corridor-{pair:04d}", *map(str, condition.values())]),
        "inputs": "-".join([f"{pair:08x}", *map(str, condition.values())]),
        "condition": json.dumps(condition),
        "detector": detector,
        "max_components": most,
        "seed": repetition,
        "repetition": repetition,
        "axes": json.dumps({"max_components": most, "detector": detector} | axes),
        "status": "noted" if place % 17 == 0 else "ok",
        "message": "reference scan: EM ran out of iterations; raise fit.max_iterations"
        if place % 17 == 0
        else "",
        "changed": True,
        "p_value": 0.01,
        "seconds": sum(seconds.values()),
        "memory": 900_000_000 + 1000 * place,
        "peak_memory": 1_100_000_000,
        "batch": f"{place // 100:08x}",
        "batch_runs": 100,
        "attempt": 1,
        "code": "0.1.0+abcdef",
        "versions": json.dumps({"novelty": "0.1.0", "torch": "2.13.0"}),
        "machine": json.dumps({"system": "Linux", "cpu_count": 2}),
        "worker": "host-1",
        "started": started,
        "finished": started + timedelta(seconds=40),
    }
    row |= {f"seconds_{stage}": value for stage, value in seconds.items()}
    factor = {"kappa": 1, "cramers_v": 1, "uncertainty": 0.8, "f1": 1, "iou": 0.9}
    row |= {metric: share * float(np.mean(list(scores.values()))) for metric, share in factor.items()}
    for direction, kappa in scores.items():
        row |= {f"{direction}_{metric}": factor.get(metric, 1) * kappa for metric in METRICS}
        row |= {f"{direction}_{count}": 1000 for count in COUNTS}
        row |= {f"{direction}_seen_once": 0.1, f"{direction}_novel_points": 2000, f"{direction}_objects": 1}
    for role in ROLES:
        path = 5e4 + 40.0 * (np.arange(1, most + 1) - order) ** 2 + rng.normal(0, 5, most)
        path[order - 1] = 5e4 - 20
        row |= {
            f"{role}_points": 30_000,
            f"{role}_cells": 4_000,
            f"{role}_components": order,
            f"{role}_mdl": float(path.min()),
            f"{role}_mdl_path": path.tolist(),
        }
    return row


def _failed(row):
    kept = (
        "key",
        "data",
        "pair",
        "inputs",
        "condition",
        "detector",
        "max_components",
        "seed",
        "repetition",
        "axes",
    )
    kept += (
        "configuration",
        "attempt",
        "code",
        "versions",
        "machine",
        "worker",
        "started",
        "finished",
        "batch",
    )
    return {key: row[key] for key in kept} | {"status": "failed", "message": OUT_OF_POINTS}


def keep_run(folder, row, number, num_points=800):
    """Labels and mixtures of a perfect answer, in the arrays that `SweepFolder` documents."""
    pair = make_pair(seed=number, num_points=num_points, labels=True)
    result = make_result(pair)
    scans = folder.scans_file(row["inputs"])
    arrays = {"center": np.zeros(3)}
    for role, scan in (("reference", pair.reference), ("current", pair.current)):
        arrays |= {f"{role}_points": scan.points.astype(np.float32), f"{role}_truth": scan.labels}
    kept = {}
    for direction, change in (("added", result.added), ("removed", result.removed)):
        records = change.components
        kept |= {
            f"{direction}_states": change.point_states,
            f"{direction}_scores": change.point_scores.astype(np.float32),
            f"{direction}_components": change.point_components.astype(np.int16),
            f"{direction}_weights": np.array([record.weight for record in records]),
            f"{direction}_means": np.stack([record.mean for record in records]),
            f"{direction}_covariances": np.stack([record.covariance for record in records]),
            f"{direction}_novel": np.array([record.novel for record in records]),
        }
    for file, content in ((scans, arrays), (folder.result_file(row["key"]), kept)):
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(file, **content)
