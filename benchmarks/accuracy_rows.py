"""What the accuracy tables are made of: one row per pair and variant, scored in batches, kept as CSV."""

from __future__ import annotations

import csv
import logging
import math
import multiprocessing
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from rich.console import Console

from novelty import Config, NoveltyResult, PointState, ScanPair, detect_many
from novelty.evaluation import (
    ContingencyTable,
    Interval,
    LabelledScores,
    Scores,
    bootstrap_interval,
    evaluate_labels,
)
from novelty.preprocess import check_scan
from novelty.result import Change, ResultStatus
from novelty.scan import CHANGED, UNCHANGED, Scan
from novelty.sweep.compute import Prepared, compute
from novelty.sweep.settings import Setting

_log = logging.getLogger(__name__)

LEVEL = 0.05
"""A p-value as low is as frequent where nothing changed, if p-values are what they claim."""


@dataclass(frozen=True)
class Case:
    """One pair to score and where it stands in a table: its data set and the condition it was recorded under."""

    data: str
    condition: str
    seed: int
    pair: ScanPair


@dataclass(frozen=True)
class Variant:
    """One line of a table: a detector with its settings."""

    name: str
    config: Config


@dataclass(frozen=True)
class Row:
    """What one variant scored on one pair; NaN where not defined.

    Attributes:
        kappa: Of the points of both scans together, so that a false alarm counts where nothing was to be found.
        seen_once: Share of the points seen in one scan only that were called novel.
        flagged: Share of the examined points of both scans that were called novel.
        objects: Objects reported in both directions.
        false_objects: Those of which less than half of the points have changed; NaN without labels.
        at_level: Share of the unchanged points (of all, without labels) with a p-value of `LEVEL` at most.
        components_at_level: Share of the components of unchanged points alone that have such a p-value.
        compare_seconds: Of the comparison alone.
        failure: Why there is no score; empty when there is one.
    """

    data: str
    condition: str
    seed: int
    pair: str
    variant: str
    kappa_added: float = math.nan
    kappa_removed: float = math.nan
    kappa: float = math.nan
    seen_once: float = math.nan
    flagged: float = math.nan
    objects: float = math.nan
    false_objects: float = math.nan
    at_level: float = math.nan
    components_at_level: float = math.nan
    seconds: float = math.nan
    compare_seconds: float = math.nan
    failure: str = ""


def scored(
    cases: Iterable[Case], variants: Sequence[Variant], batch_size: int, workers: int = 1
) -> Iterator[Row]:
    """Score every variant on every case, `batch_size` pairs at a time; variants share what stages they can."""
    remaining, done = iter(cases), 0
    batches = iter(lambda: list(islice(remaining, batch_size)), [])
    with Console(stderr=True).status("Making the first pairs") as status:
        for rows in _in_processes(partial(_score_batch, variants=variants), batches, workers):
            done += len(rows)
            status.update(f"{done} rows done; {rows[-1].data}, {rows[-1].condition}")
            yield from rows


def _in_processes(
    score: Callable[[list[Case]], list[Row]], batches: Iterator[list[Case]], workers: int
) -> Iterator[list[Row]]:
    """The rows of every batch, in order; the next cases are made while the workers score."""
    if workers <= 1:
        yield from map(score, batches)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        waiting: deque[Future[list[Row]]] = deque()
        for batch in batches:
            waiting.append(pool.submit(score, batch))
            if len(waiting) > workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _score_batch(cases: list[Case], variants: Sequence[Variant]) -> list[Row]:
    """The rows of a batch, variant by variant; a batch that breaks is scored as `detect_many` does, pair by pair."""
    pairs = [case.pair for case in cases]
    settings = [Setting(i, variant.config, {}, 0) for i, variant in enumerate(variants)]
    try:
        for scan in (scan for pair in pairs for scan in (pair.reference, pair.current)):
            check_scan(scan)
        outcomes = list(compute(Prepared.of(pairs, settings, None), None))
    except Exception as error:
        _log.warning("a batch is scored pair by pair: %s: %s", type(error).__name__, error)
        results = [(i, detect_many(pairs, variant.config)) for i, variant in enumerate(variants)]
        return [row_of(c, variants[i].name, r) for i, rs in results for c, r in zip(cases, rs, strict=True)]
    outcomes.sort(key=lambda outcome: (outcome.setting.index, outcome.place))
    return [row_of(cases[o.place], variants[o.setting.index].name, o.result) for o in outcomes]


def row_of(case: Case, variant: str, result: NoveltyResult) -> Row:
    """The scores of one answer."""
    place = (case.data, case.condition, case.seed, case.pair.name, variant)
    if result.status is ResultStatus.FAILED:
        return Row(*place, failure=result.message)
    sides = ((case.pair.current, result.added), (case.pair.reference, result.removed))
    labelled = [
        evaluate_labels(scan.labels, change.point_labels) for scan, change in sides if scan.labels is not None
    ]
    examined = sum(int((change.point_states != PointState.NOT_EXAMINED).sum()) for _, change in sides)
    return Row(
        *place,
        **_agreement(labelled),
        flagged=sum(int(change.point_labels.sum()) for _, change in sides) / max(examined, 1),
        objects=sum(len(change.objects) for _, change in sides),
        false_objects=sum(_false_objects(scan, change) for scan, change in sides),
        at_level=_share_at_level(_unchanged_points(*side) for side in sides),
        components_at_level=_share_at_level(_unchanged_components(*side) for side in sides),
        seconds=sum(result.timings.values()),
        compare_seconds=result.timings["compare"],
    )


def _agreement(labelled: list[LabelledScores]) -> dict[str, float]:
    if len(labelled) < 2:
        return {}
    added, removed = labelled
    seen_once = [np.nan_to_num(side.seen_once_called_novel) * side.num_seen_once for side in labelled]
    total = sum(side.num_seen_once for side in labelled)
    return {
        "kappa_added": added.scores.kappa,
        "kappa_removed": removed.scores.kappa,
        "kappa": Scores.from_table(_pooled(added.scores.table, removed.scores.table)).kappa,
        "seen_once": sum(seen_once) / total if total else math.nan,
    }


def _share_at_level(p_values: Iterable[np.ndarray]) -> float:
    """Share of p-values of both scans that are `LEVEL` at most; NaN where there are none."""
    known = np.concatenate(list(p_values))
    known = known[np.isfinite(known)]
    return float(np.mean(known <= LEVEL)) if len(known) else math.nan


def _unchanged_points(scan: Scan, change: Change) -> np.ndarray:
    if scan.labels is None:
        return change.point_p_values
    return change.point_p_values[scan.labels == UNCHANGED]


def _unchanged_components(scan: Scan, change: Change) -> np.ndarray:
    """P-values of the components that have points, all of which are unchanged (of all, without labels)."""
    held = change.point_components
    spoilt = held[scan.labels != UNCHANGED] if scan.labels is not None else held[:0]
    wanted = np.setdiff1d(held[held >= 0], spoilt)
    known = {component.index: component.p_value for component in change.components}
    return np.array([known[k] for k in wanted.tolist() if k in known], dtype=float)


def _pooled(*tables: ContingencyTable) -> ContingencyTable:
    return ContingencyTable(*(sum(getattr(t, f.name) for t in tables) for f in fields(ContingencyTable)))


def _false_objects(scan: Scan, change: Change) -> float:
    """Objects whose box holds a majority of called points that have not changed; NaN without labels."""
    if scan.labels is None:
        return math.nan
    points, changed = scan.points[change.point_labels], scan.labels[change.point_labels] == CHANGED
    count = 0
    for thing in change.objects:
        inside = np.abs((points - thing.center) @ thing.rotation) <= thing.extent / 2 + 1e-9
        count += changed[inside.all(axis=1)].mean() < 0.5 if inside.all(axis=1).any() else False
    return float(count)


def interval(rows: Iterable[Row], column: str = "kappa") -> Interval:
    """Mean of a column over rows, with its bootstrap interval."""
    return bootstrap_interval([getattr(row, column) for row in rows])


def grouped(rows: Iterable[Row], key: Callable[[Row], tuple[str, ...]]) -> dict[tuple[str, ...], list[Row]]:
    """Rows by a key, in order of first appearance."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def recorded(file: Path, rows: Iterable[Row]) -> list[Row]:
    """All rows, written as they come, so that a run that is cut short leaves those it has made."""
    file.parent.mkdir(parents=True, exist_ok=True)
    kept = []
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, [field.name for field in fields(Row)])
        writer.writeheader()
        for row in rows:
            writer.writerow(asdict(row))
            stream.flush()
            kept.append(row)
    return kept


class Stopwatch:
    """Wall seconds since it was made."""

    def __init__(self) -> None:
        self._start = time.perf_counter()

    @property
    def seconds(self) -> float:
        return time.perf_counter() - self._start
