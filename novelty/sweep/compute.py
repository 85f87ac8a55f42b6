"""All settings of a sweep on a batch of pairs, every stage made once for all the runs that share it.

The settings form a tree: those with one preprocessing share the prepared scans, of these those with one registration
share the poses, of these those with one kind of fit are fitted as one tensor batch (each K_max and each seed of each
pair is a member of it) by which detectors share what they have in common. Only the comparison and the labels are made
run by run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import torch

from novelty.config import Config
from novelty.fitting import FitPlan, Models
from novelty.pipeline import Clock, Measured, compare_fitted
from novelty.preprocess import PreparedPairs, PreparedScans, prepare_pairs
from novelty.registration import Registrations, register
from novelty.result import NoveltyResult
from novelty.scan import ScanPair
from novelty.sweep.settings import Setting

T = TypeVar("T")


@dataclass(frozen=True)
class Outcome:
    """The answer of one run: of the pair at this place of the batch under this setting."""

    place: int
    setting: Setting
    result: NoveltyResult


@dataclass(frozen=True, eq=False)
class Prepared:
    """Pairs of scans and what the first settings need of them, made ahead of the rest.

    `seconds` are those of the preparation.
    """

    pairs: tuple[ScanPair, ...]
    settings: tuple[Setting, ...]
    first: PreparedPairs
    seconds: float

    @staticmethod
    def of(pairs: Sequence[ScanPair], settings: Sequence[Setting], unit: str | None) -> Prepared:
        """Prepare pairs for settings.

        Args:
            pairs: P usable pairs, all in one unit.
            settings: What is to be run on them.
            unit: Their unit; None: what each configuration says.
        """
        start = time.perf_counter()
        first = _prepare(pairs, _in_unit(settings[0].config, unit))
        return Prepared(tuple(pairs), tuple(settings), first, time.perf_counter() - start)


@dataclass(frozen=True, eq=False)
class _Branch:
    """A branch of the tree: its settings, and what each of its runs owes so far, in seconds per stage."""

    configs: dict[Setting, Config]
    owed: dict[str, float] = field(default_factory=dict)

    def branches(self, stage: Callable[[Config], Hashable]) -> Iterator[_Branch]:
        """One branch per distinct value of what a stage depends on."""
        groups: dict[Hashable, dict[Setting, Config]] = {}
        for setting, config in self.configs.items():
            groups.setdefault(stage(config), {})[setting] = config
        for configs in groups.values():
            yield _Branch(configs, self.owed)

    def charged(self, stage: str, seconds: float, pairs: int) -> _Branch:
        """The same after a stage that all its runs on these pairs share evenly."""
        return replace(self, owed={**self.owed, stage: seconds / (pairs * len(self.configs))})

    @property
    def any(self) -> Config:
        """One of the configurations, where all agree."""
        return next(iter(self.configs.values()))


def compute(prepared: Prepared, unit: str | None) -> Iterator[Outcome]:
    """The answers of all runs, in the order in which they are computed."""
    pairs = prepared.pairs
    everything = _Branch({setting: _in_unit(setting.config, unit) for setting in prepared.settings})
    # Section 2.2.
    for number, branch in enumerate(everything.branches(lambda config: (config.preprocess, config.unit))):
        ahead = (prepared.first, prepared.seconds)
        batch, seconds = _timed(partial(_prepare, pairs, branch.any)) if number else ahead
        yield from _registered(pairs, batch, branch.charged("preprocess", seconds, len(pairs)))


def _registered(pairs: tuple[ScanPair, ...], batch: PreparedPairs, prepared: _Branch) -> Iterator[Outcome]:
    """Refine the given poses, then fit."""
    for branch in prepared.branches(lambda config: config.registration):
        registrations, seconds = _timed(partial(register, batch, branch.any.registration))
        aligned = batch.aligned(registrations.transforms, registrations.residual)
        measured: Measured = {}
        for posed in branch.charged("register", seconds, len(pairs)).branches(lambda c: c.fit):
            yield from _compared(pairs, aligned, registrations, posed, measured)


def _compared(
    pairs: tuple[ScanPair, ...],
    batch: PreparedPairs,
    registrations: Registrations,
    posed: _Branch,
    measured: Measured,
) -> Iterator[Outcome]:
    """Fit all orders for all detectors, then compare and label run by run (section 2.4)."""
    models, seconds = _timed(partial(_fits, batch, list(posed.configs.values())))
    fitted = posed.charged("fit", seconds, len(pairs))
    for setting, config in fitted.configs.items():
        clock = Clock()
        own = models[config.chosen_detector, config.max_components, config.seed]
        results = compare_fitted(pairs, batch, registrations, own, config, clock, measured)
        seconds_each = {stage: total / len(pairs) for stage, total in clock.seconds.items()}
        for place, result in enumerate(results):
            yield Outcome(place, setting, replace(result, timings=fitted.owed | seconds_each))


def _fits(batch: PreparedPairs, configs: Sequence[Config]) -> dict[tuple[Hashable, int, int], Models]:
    """The mixtures of P pairs for every detector, K_max and seed, by all three, fitted as members of one batch."""
    kinds = sorted({(config.max_components, config.seed) for config in configs})
    pairs = len(batch)
    members = [pair for _ in kinds for pair in range(pairs)]
    cells = PreparedPairs(
        _cells_alone(batch.reference).select(members),
        _cells_alone(batch.current).select(members),
        None if batch.misalignment is None else batch.misalignment[members],
    )
    plan = FitPlan(
        settings=configs[0].fit,
        max_components=[order for order, _ in kinds for _ in range(pairs)],
        seed=[seed for _, seed in kinds for _ in range(pairs)],
        made={},
    )
    found: dict[tuple[Hashable, int, int], Models] = {}
    for detector in dict.fromkeys(config.chosen_detector for config in configs):
        models = detector.fit(cells, plan)
        for number, (order, seed) in enumerate(kinds):
            rows = range(number * pairs, (number + 1) * pairs)
            found[detector, order, seed] = models.select(rows, order)
    return found


def _cells_alone(scans: PreparedScans) -> PreparedScans:
    """The scans as far as a fit sees them: without their points, which would be copied for every member."""
    return replace(scans, points=scans.cells, cell_of_point=torch.arange(len(scans.cells.points)))


def _prepare(pairs: Sequence[ScanPair], config: Config) -> PreparedPairs:
    return prepare_pairs(pairs, config.preprocess, config.unit)


def _in_unit(config: Config, unit: str | None) -> Config:
    return config if unit in (None, config.unit) else config.replace(unit=unit)


def _timed(make: Callable[[], T]) -> tuple[T, float]:
    start = time.perf_counter()
    made = make()
    return made, time.perf_counter() - start
