"""The plan: which pairs and settings are computed together.

The plan depends on the sweep and the limits alone, not on what is done already, so that a sweep that was interrupted
goes on with the same batches and comes to the same rows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from novelty.sweep.batch import Batch
from novelty.sweep.estimate import Cost, CostModel
from novelty.sweep.inputs import HashedPair, InputHashes, run_key
from novelty.sweep.settings import Setting, canonical_json
from novelty.sweep.sources import SweepPair
from novelty.sweep.store import RowStore

MAX_PAIRS = 32
"""Pairs of a batch at most: more make a tensor batch no faster."""


@dataclass(frozen=True)
class Limits:
    """What a batch may cost.

    Attributes:
        memory: Bytes that one worker may use.
        seconds: About how long a batch may take on one core: what is lost when a sweep is killed.
        pairs: Pairs at most.
    """

    memory: float
    seconds: float = 60.0
    pairs: int = MAX_PAIRS


@dataclass(frozen=True)
class Left:
    """What is left to do of a planned batch.

    Attributes:
        batches: Usually none or one; several where the pairs lack different settings.
        finished: Runs that have a row.
        failed: Of these, without an answer.
    """

    batches: tuple[Batch, ...]
    finished: int
    failed: int


@dataclass(frozen=True)
class PlannedBatch:
    """Pairs and settings that are computed together, and what that will cost, about."""

    name: str
    pairs: tuple[SweepPair, ...]
    settings: tuple[Setting, ...]
    cost: Cost

    @property
    def num_runs(self) -> int:
        """Number of rows."""
        return len(self.pairs) * len(self.settings)

    def left(self, hashes: InputHashes, store: RowStore, retry_failed: bool) -> Left:
        """What the store lacks; failed runs count as lacking where they are to be tried again."""
        store.refresh()
        lacking: dict[tuple[Setting, ...], list[HashedPair]] = {}
        attempts: dict[str, int] = {}
        failed = 0
        for pair in self.pairs:
            hashed = HashedPair(pair, hashes.of(pair))
            done = {setting: store.finished.get(run_key(hashed, setting)) for setting in self.settings}
            again = {s: row for s, row in done.items() if row is not None and row.failed and retry_failed}
            attempts |= {run_key(hashed, setting): row.attempt + 1 for setting, row in again.items()}
            failed += sum(row is not None and row.failed for row in done.values()) - len(again)
            lacking.setdefault(tuple(s for s, row in done.items() if row is None or s in again), []).append(
                hashed
            )
        batches = [
            Batch(f"{self.name}-{number}" if number else self.name, tuple(pairs), settings, attempts)
            for number, (settings, pairs) in enumerate(lacking.items())
            if settings
        ]
        return Left(tuple(batches), self.num_runs - sum(batch.num_runs for batch in batches), failed)


def plan_batches(
    pairs: Sequence[SweepPair], settings: Sequence[Setting], costs: CostModel, limits: Limits
) -> Iterator[PlannedBatch]:
    """Cut a sweep into batches: consecutive pairs of one unit, each with as many settings as the limits allow."""
    number = 0
    parts = _parts(settings, costs, max(map(costs.points, pairs), default=0.0), limits)
    for together in _together(pairs, parts[0], costs, limits):
        points = sum(map(costs.points, together))
        for part in parts:
            yield PlannedBatch(f"{number:06d}", tuple(together), part, costs.of(points, part))
            number += 1


def _parts(
    settings: Sequence[Setting], costs: CostModel, points: float, limits: Limits
) -> list[tuple[Setting, ...]]:
    """The settings, cut where one pair under all of them would take too long; what shares stages stays together."""
    ordered = sorted(settings, key=_stages)
    count = min(len(ordered), math.ceil(costs.of(points, ordered).seconds / limits.seconds) or 1)
    bounds = [len(ordered) * part // count for part in range(count + 1)]
    return [tuple(ordered[start:end]) for start, end in itertools.pairwise(bounds)]


def _stages(setting: Setting) -> tuple[str, ...]:
    """What the stages depend on, from the first to the last."""
    mapping = setting.config.to_mapping()
    keys = ("preprocess", "registration", "fit", "seed")
    return tuple(canonical_json(mapping[key]) for key in keys)


def _together(
    pairs: Sequence[SweepPair], settings: Sequence[Setting], costs: CostModel, limits: Limits
) -> Iterator[list[SweepPair]]:
    batch: list[SweepPair] = []
    points = 0.0
    for pair in pairs:
        more = points + costs.points(pair)
        if batch and (
            len(batch) >= limits.pairs
            or pair.unit != batch[0].unit
            or _exceeds(costs.of(more, settings), limits)
        ):
            yield batch
            batch, more = [], costs.points(pair)
        batch.append(pair)
        points = more
    if batch:
        yield batch


def _exceeds(cost: Cost, limits: Limits) -> bool:
    return cost.memory > limits.memory or cost.seconds > limits.seconds
