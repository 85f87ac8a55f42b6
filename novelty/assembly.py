"""From packed tensors over a batch to one `NoveltyResult` per pair, in the scans' own order and unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from gmmtorch import FitResult, Status
from novelty.clusters import novel_clusters
from novelty.detectors import Comparison, ComponentNovelty, PointNovelty
from novelty.detectors.p_values import least_p_value
from novelty.fitting import Models, advice_of
from novelty.objects import Move, Things, describe_objects, find_moves, mark_moves, number_objects
from novelty.preprocess import PreparedPairs, PreparedScans, metres_per
from novelty.registration import Registrations
from novelty.result import Change, ComponentRecord, NoveltyResult, PointState, ResultStatus
from novelty.scan import Scan, ScanPair
from novelty.segment import SegmentedPoints

MOSTLY_CHANGED = 0.5
"""Share of the examined points of a scan above which its change is doubted."""


@dataclass(frozen=True, eq=False)
class PairOutcome:
    """Everything known about P pairs after the last stage; `up` is the direction away from the ground."""

    batch: PreparedPairs
    registrations: Registrations
    models: Models
    comparison: Comparison
    added: SegmentedPoints
    removed: SegmentedPoints
    notes: Sequence[tuple[str, ...]]
    up: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class _Side:
    """One role of the pairs: its scans, mixtures, what the detector said, and the labelled points.

    `back` (P, 4, 4) takes the common frame to the frame of the scans as given; `groups` (N,) are the novel points in
    contact.
    """

    kind: str
    scans: PreparedScans
    fits: FitResult
    novelty: ComponentNovelty | PointNovelty
    points: SegmentedPoints
    groups: torch.Tensor
    back: torch.Tensor


def assemble(pairs: Sequence[ScanPair], outcome: PairOutcome, unit: str) -> list[NoveltyResult]:
    """Build the results of all pairs, without timings.

    Args:
        pairs: The P pairs as given.
        outcome: What the stages found.
        unit: Unit of the scans as given; records are converted back to it.
    """
    added, removed = _added_side(outcome), _removed_side(outcome)
    outcome = replace(outcome, comparison=_with_what_stands(outcome.comparison, added, removed))
    return [
        _pair_result(row, pair, added, removed, outcome, metres_per(unit)) for row, pair in enumerate(pairs)
    ]


def _with_what_stands(comparison: Comparison, added: _Side, removed: _Side) -> Comparison:
    """The comparison with p-values of the pairs for which only what stands is evidence.

    A novel component none of whose points are novel any more was hidden from the other scan, or found unchanged.
    """
    if comparison.p_value.isnan().all():
        return comparison
    p_value = least_p_value(*(_standing(side) for side in (added, removed))).nan_to_num(1.0)
    return replace(comparison, p_value=torch.where(comparison.p_value.isnan(), torch.nan, p_value))


def _standing(side: _Side) -> ComponentNovelty:
    """What was said of the components, without the p-values of the novel ones that have no novel point."""
    novelty = side.novelty
    assert isinstance(novelty, ComponentNovelty)
    assert novelty.p_values is not None
    P, K = novelty.novel.shape
    places = (side.scans.points.cloud_index * K + side.points.components)[side.points.labels]
    stands = ~novelty.novel | (torch.bincount(places, minlength=P * K) > 0).reshape(P, K)
    return replace(novelty, p_values=torch.where(stands, novelty.p_values, torch.nan))


def _added_side(outcome: PairOutcome) -> _Side:
    scans, points = outcome.batch.current, outcome.added
    groups = novel_clusters(scans, points.labels)
    back = torch.linalg.inv(outcome.registrations.transforms)
    return _Side("added", scans, outcome.models.current, outcome.comparison.added, points, groups, back)


def _removed_side(outcome: PairOutcome) -> _Side:
    scans, points = outcome.batch.reference, outcome.removed
    groups = novel_clusters(scans, points.labels)
    back = torch.eye(4, dtype=torch.float64).expand(len(scans), 4, 4)
    return _Side("removed", scans, outcome.models.reference, outcome.comparison.removed, points, groups, back)


def _pair_result(
    row: int, pair: ScanPair, added: _Side, removed: _Side, outcome: PairOutcome, metres: float
) -> NoveltyResult:
    comparison = outcome.comparison
    changes = mark_moves(
        _change(row, pair.current, added, metres),
        _change(row, pair.reference, removed, metres),
        _moves(row, added, removed, outcome),
        metres,
    )
    notes = [
        *_notes("reference", row, removed),
        *_notes("current", row, added),
        *filter(None, [outcome.registrations.note(row)]),
        *comparison.notes[row],
        *outcome.notes[row],
        *filter(
            None,
            [_doubt(role, change) for role, change in zip(("current", "reference"), changes, strict=True)],
        ),
    ]
    return NoveltyResult(
        name=pair.name,
        changed=any(bool(change.point_labels.any()) for change in changes),
        p_value=float(comparison.p_value[row]),
        distance=float(comparison.distance[row]),
        status=ResultStatus.NOTED if notes else ResultStatus.OK,
        message="\n".join(notes),
        timings={},
        added=changes[0],
        removed=changes[1],
        registration=_registration_record(row, outcome.registrations),
        details={"reference": _details(row, removed), "current": _details(row, added)},
    )


def _doubt(role: str, change: Change) -> str:
    """What is to be checked where most of a scan has changed: that is rarely what happened to a place."""
    share = change.point_labels.sum() / max(change.num_examined, 1)
    if share <= MOSTLY_CHANGED:
        return ""
    return (
        f"{share:.0%} of the {role} scan have no counterpart: make sure that both scans show one place and are in one "
        "frame and unit."
    )


def _moves(row: int, added: _Side, removed: _Side, outcome: PairOutcome) -> list[Move]:
    resolution = outcome.batch.resolution[row]
    return find_moves(_things(row, removed), _things(row, added), float(resolution), outcome.up)


def _things(row: int, side: _Side) -> Things:
    """The objects of one scan in the common frame, numbered as in `Change.objects`."""
    split = side.scans.points.split
    points = split(side.scans.points.points)[row].numpy()
    objects = number_objects(split(side.groups)[row].numpy())
    return Things(
        points=tuple(points[objects == index] for index in range(objects.max(initial=-1) + 1)),
        stations=side.scans.stations[row],
    )


def _change(row: int, scan: Scan, side: _Side, metres: float) -> Change:
    kept = side.scans.kept[row]
    split = side.scans.points.split

    def scatter(packed: Any, missing: Any) -> Any:
        values = split(packed)[row].numpy()
        whole = np.full(scan.num_points, missing, dtype=values.dtype)
        whole[kept] = values
        return whole

    states = scatter(side.points.states, int(PointState.NOT_EXAMINED))
    point_components = scatter(side.points.components, -1)
    point_scores = scatter(side.points.scores, np.nan)
    point_p_values = scatter(side.points.p_values, np.nan)
    components = _component_records(row, side, metres)
    point_objects = number_objects(scatter(side.groups, -1))
    return Change(
        point_labels=(states == PointState.NOVEL) | (states == PointState.MOVED),
        point_scores=point_scores,
        point_p_values=point_p_values,
        point_states=states,
        point_components=point_components,
        point_objects=point_objects,
        components=components,
        objects=describe_objects(
            scan.points,
            point_objects,
            point_components,
            point_scores,
            point_p_values,
            components,
            side.points.overlaps[row].numpy(),
            side.kind,
        ),
    )


def _component_records(row: int, side: _Side, metres: float) -> tuple[ComponentRecord, ...]:
    mixture, novelty = side.fits.mixtures, side.novelty
    if isinstance(novelty, PointNovelty):
        return ()
    weights = mixture.weights[row].tolist()
    turn, shift = side.back[row, :3, :3].numpy(), side.back[row, :3, 3].numpy()
    return tuple(
        ComponentRecord(
            index=k,
            weight=weight,
            mean=(turn @ mixture.means[row, k].numpy() + shift) / metres,
            covariance=turn @ mixture.covariances[row, k].numpy() @ turn.T / metres**2,
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
    status = Status(int(side.fits.status[row]))  # type: ignore[call-arg]
    if status is not Status.OK:
        notes.append(f"{role} scan: {advice_of(status)}")
    return notes


def _registration_record(row: int, registrations: Registrations) -> dict[str, Any]:
    """What registration did; lengths in metres, angles in degrees."""
    status = registrations.status_of(row)
    return {
        "status": status.name,
        "transform": registrations.transforms[row].tolist(),
        "shift_m": float(registrations.shift[row]),
        "turn_deg": float(registrations.turn[row]),
        "residual_m": float(registrations.residual[row]),
        "overlap": float(registrations.overlap[row]),
    }


def _details(row: int, side: _Side) -> dict[str, Any]:
    path = side.fits.mdl_path[row]
    reached = path.isfinite().nonzero().flatten().tolist()  # other pairs of the batch have longer ones
    return {
        "points_given": side.scans.num_given[row],
        "points_examined": len(side.scans.kept[row]),
        "points_dropped": dict(side.scans.dropped[row]),
        "cells": side.scans.cells.sizes[row],
        "spacing_m": float(side.scans.spacing[row]),
        "cell_size_m": float(side.scans.cell_size[row]),
        "num_components": int(side.fits.mixtures.num_components[row]),
        "mdl": float(side.fits.mdl[row]),
        "mdl_path": path[: reached[-1] + 1 if reached else 0].tolist(),
        "fit_status": Status(int(side.fits.status[row])).name,  # type: ignore[call-arg]
    }
