"""From the answer of a run to its row."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from novelty.evaluation import LabelledScores, evaluate_labels
from novelty.result import Change, NoveltyResult
from novelty.scan import Scan, ScanPair
from novelty.sweep.rows import METRICS, STAGES

MEANS = ("kappa", "cramers_v", "uncertainty", "f1", "iou")
"""Metrics of which a row holds the mean of both directions as well."""

READ = "read"

COUNTS = {
    "tp": "true_positives",
    "fn": "false_negatives",
    "fp": "false_positives",
    "tn": "true_negatives",
}
"""Columns of the contingency table."""


def outcome_columns(scans: ScanPair, result: NoveltyResult, seconds_read: float) -> dict[str, Any]:
    """The columns that say what came out of a run and what it cost."""
    added, removed = _scores(scans.current, result.added), _scores(scans.reference, result.removed)
    timings = {READ: seconds_read, **result.timings}
    return {
        "status": str(result.status),
        "message": result.message,
        "changed": result.changed,
        "p_value": result.p_value,
        "distance": result.distance,
        **{
            metric: _mean(getattr(side.scores, metric) for side in (added, removed) if side)
            for metric in MEANS
        },
        **_direction("added", result.added, added),
        **_direction("removed", result.removed, removed),
        **_mixture("reference", result.details["reference"], len(result.removed.components)),
        **_mixture("current", result.details["current"], len(result.added.components)),
        **{f"seconds_{stage}": timings.get(stage, 0.0) for stage in STAGES},
        "seconds": sum(timings.values()),
    }


def _scores(scan: Scan, change: Change) -> LabelledScores | None:
    return None if scan.labels is None else evaluate_labels(scan.labels, change.point_labels)


def _direction(name: str, change: Change, labelled: LabelledScores | None) -> dict[str, Any]:
    columns: dict[str, Any] = {
        f"{name}_novel_points": int(change.point_labels.sum()),
        f"{name}_objects": len(change.objects),
    }
    if labelled is not None:
        scores = labelled.scores
        columns |= {f"{name}_{metric}": getattr(scores, metric) for metric in METRICS}
        columns |= {f"{name}_{column}": getattr(scores.table, count) for column, count in COUNTS.items()}
        columns[f"{name}_seen_once"] = labelled.seen_once_called_novel
    return columns


def _mixture(role: str, details: dict[str, Any], num_components: int) -> dict[str, Any]:
    """Size and mixture of a scan; a baseline without mixtures has no order and no description length."""
    columns = {f"{role}_points": details["points_given"], f"{role}_cells": details["cells"]}
    if num_components:
        columns |= {
            f"{role}_components": num_components,
            f"{role}_mdl": details["mdl"],
            f"{role}_mdl_path": details["mdl_path"],
        }
    return columns


def _mean(values: Iterable[float]) -> float:
    """Mean of the defined values; NaN when none is."""
    defined = [value for value in values if not math.isnan(value)]
    return sum(defined) / len(defined) if defined else math.nan
