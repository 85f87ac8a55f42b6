"""`result.json`: everything about a run that is not one number per point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from novelty.environment import machine, versions
from novelty.evaluation import LabelledScores
from novelty.report.answer import headline, notes, unseen
from novelty.report.run import Run
from novelty.result import Change, NoveltyResult, PointState
from novelty.scan import Scan, ScanPair

FORMAT = 1
"""Raised when a key of the record changes its meaning."""


def result_record(
    pair: ScanPair, result: NoveltyResult, run: Run, scores: Mapping[str, LabelledScores]
) -> dict[str, Any]:
    """Nested plain values; labels and scores of the points are in the PLY files beside it."""
    return {
        "format": FORMAT,
        "name": result.name,
        "answer": headline(result),
        "changed": result.changed,
        "p_value": result.p_value,
        "distance": result.distance,
        "status": str(result.status),
        "unseen": unseen(result),
        "notes": notes(result),
        "added": _change(pair.current, result.added),
        "removed": _change(pair.reference, result.removed),
        "scores": {direction: _scores(labelled) for direction, labelled in scores.items()},
        "registration": result.registration,
        "timings": result.timings,
        "details": result.details,
        "command": run.command,
        "settings": run.settings,
        "versions": versions(),
        "machine": machine(),
    }


def _change(scan: Scan, change: Change) -> dict[str, Any]:
    return {
        "scan": scan.name,
        "points": scan.num_points,
        "points_examined": change.num_examined,
        "points_novel": int(change.point_labels.sum()),
        "points_occluded": change.count(PointState.OCCLUDED),
        "points_unobserved": change.count(PointState.UNOBSERVED),
        "objects": [asdict(record) for record in change.objects],
        "components": [asdict(record) for record in change.components],
    }


def _scores(labelled: LabelledScores) -> dict[str, Any]:
    return {
        **labelled.scores.to_dict(),
        "undefined": dict(labelled.scores.reasons),
        "seen_once_points": labelled.num_seen_once,
        "seen_once_called_novel": labelled.seen_once_called_novel,
        "ambiguous_points": labelled.num_ambiguous,
    }
