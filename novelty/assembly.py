"""From packed tensors over a batch to one `NoveltyResult` per pair, in the scans' own order and unit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gmmtorch import FitResult, Status
from novelty.detectors import Comparison, ComponentNovelty
from novelty.fitting import Models
from novelty.objects import group_objects
from novelty.preprocess import PreparedPairs, PreparedScans, metres_per
from novelty.result import Change, ComponentRecord, NoveltyResult, PointState, ResultStatus
from novelty.scan import Scan, ScanPair
from novelty.segment import SegmentedPoints


@dataclass(frozen=True, eq=False)
class PairOutcome:
    """Everything known about P pairs after the last stage."""

    batch: PreparedPairs
    models: Models
    comparison: Comparison
    added: SegmentedPoints
    removed: SegmentedPoints


@dataclass(frozen=True, eq=False)
class _Side:
    """One role of the pairs: its scans, mixtures, what the detector said, and the labelled points."""

    kind: str
    scans: PreparedScans
    fits: FitResult
    novelty: ComponentNovelty
    points: SegmentedPoints


def assemble(
    pairs: Sequence[ScanPair], outcome: PairOutcome, unit: str, seconds: Mapping[str, float]
) -> list[NoveltyResult]:
    """Build the results of all pairs.

    Args:
        pairs: The P pairs as given.
        outcome: What the stages found.
        unit: Unit of the scans as given; records are converted back to it.
        seconds: Wall seconds of each stage for the whole batch.
    """
    batch, comparison = outcome.batch, outcome.comparison
    added = _Side("added", batch.current, outcome.models.current, comparison.added, outcome.added)
    removed = _Side("removed", batch.reference, outcome.models.reference, comparison.removed, outcome.removed)
    timings = {stage: duration / len(pairs) for stage, duration in seconds.items()}
    return [
        _pair_result(row, pair, added, removed, comparison, metres_per(unit), timings)
        for row, pair in enumerate(pairs)
    ]


def _pair_result(
    row: int,
    pair: ScanPair,
    added: _Side,
    removed: _Side,
    comparison: Comparison,
    metres: float,
    timings: dict[str, float],
) -> NoveltyResult:
    changes = [_change(row, pair.current, added, metres), _change(row, pair.reference, removed, metres)]
    notes = [*_notes("current", row, added), *_notes("reference", row, removed), *comparison.notes[row]]
    return NoveltyResult(
        name=pair.name,
        changed=any(bool(change.point_labels.any()) for change in changes),
        p_value=float(comparison.p_value[row]),
        distance=float(comparison.distance[row]),
        status=ResultStatus.NOTED if notes else ResultStatus.OK,
        message="\n".join(notes),
        timings=timings,
        added=changes[0],
        removed=changes[1],
        details={"reference": _details(row, removed), "current": _details(row, added)},
    )


def _change(row: int, scan: Scan, side: _Side, metres: float) -> Change:
    kept = side.scans.kept[row]
    split = side.scans.points.split

    def scatter(packed: Any, missing: Any) -> Any:
        values = split(packed)[row].numpy()
        whole = np.full(scan.num_points, missing, dtype=values.dtype)
        whole[kept] = values
        return whole

    labels = scatter(side.points.labels, False)
    states = np.full(scan.num_points, PointState.NOT_EXAMINED, dtype=np.uint8)
    states[kept] = np.where(labels[kept], PointState.NOVEL, PointState.UNCHANGED)
    point_components = scatter(side.points.components, -1)
    components = _component_records(row, side, metres)
    return Change(
        point_labels=labels,
        point_scores=scatter(side.points.scores, np.nan),
        point_states=states,
        point_components=point_components,
        components=components,
        objects=group_objects(
            scan.points, point_components, labels, components, side.points.overlaps[row].numpy(), side.kind
        ),
    )


def _component_records(row: int, side: _Side, metres: float) -> tuple[ComponentRecord, ...]:
    mixture, novelty = side.fits.mixtures, side.novelty
    weights = mixture.weights[row].tolist()
    return tuple(
        ComponentRecord(
            index=k,
            weight=weight,
            mean=mixture.means[row, k].numpy() / metres,
            covariance=mixture.covariances[row, k].numpy() / metres**2,
            num_points=int(side.points.counts[row, k]),
            novel=bool(novelty.novel[row, k]),
            score=float(novelty.scores[row, k]),
            p_value=math.nan if novelty.p_values is None else float(novelty.p_values[row, k]),
            match=int(novelty.matches[row, k]),
            distance=float(novelty.distances[row, k]),
            reason=novelty.reasons[row][k],
        )
        for k, weight in enumerate(weights)
        if weight > 0
    )


def _notes(role: str, row: int, side: _Side) -> list[str]:
    notes = [f"{role} scan: {note}" for note in side.scans.notes[row]]
    status = Status(int(side.fits.status[row]))
    if status is not Status.OK:
        notes.append(f"{role} scan: {status.advice}")
    return notes


def _details(row: int, side: _Side) -> dict[str, Any]:
    path = side.fits.mdl_path[row].tolist()
    return {
        "points_given": side.scans.num_given[row],
        "points_examined": len(side.scans.kept[row]),
        "points_dropped": dict(side.scans.dropped[row]),
        "cells": side.scans.cells.sizes[row],
        "spacing_m": float(side.scans.spacing[row]),
        "cell_size_m": float(side.scans.cell_size[row]),
        "num_components": int(side.fits.mixtures.num_components[row]),
        "mdl": float(side.fits.mdl[row]),
        "mdl_path": path,
        "fit_status": Status(int(side.fits.status[row])).name,
    }
