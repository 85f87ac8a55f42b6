"""The paper's block diagram (Fig. 1) over a batch of pairs: preprocess, fit, compare, segment.

`detect` is the batch of one. In a batch a pair that has no answer is reported in its place and the others go on.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from novelty.assembly import PairOutcome, assemble
from novelty.clusters import drop_specks
from novelty.config import Config
from novelty.detectors import ComponentNovelty, PointNovelty
from novelty.errors import InputError, NoveltyError
from novelty.fitting import FitPlan, Models
from novelty.preprocess import PreparedPairs, check_scan, prepare_pairs
from novelty.put_aside import drop_measured
from novelty.refinement import OffSurface, Refine, measure_off_surface, refine
from novelty.registration import Registrations, register
from novelty.result import Change, NoveltyResult, ResultStatus
from novelty.scan import ScanPair
from novelty.segment import SegmentedPoints, label_points, segment_points
from novelty.visibility import blind_notes, judge

_log = logging.getLogger(__name__)

Measured = dict[tuple[int, Refine], OffSurface]
"""How far scans of a batch, by identity, are off the surfaces of the others."""


def detect(pair: ScanPair, config: Config | None = None) -> NoveltyResult:
    """Find what is new and what is gone between the two scans of a pair.

    Args:
        pair: Two scans in one coordinate frame.
        config: Settings; the defaults need no tuning.

    Returns:
        The labels of every point of both scans, in the order given, and the components and objects behind them.

    Raises:
        InputError: A scan has no answer: no points, no finite point, or all points identical.
    """
    failure = _failure(pair)
    if failure is not None:
        raise InputError(failure)
    return _detect_usable([pair], config or Config())[0]


def detect_many(pairs: Sequence[ScanPair], config: Config | None = None) -> list[NoveltyResult]:
    """Find what is new and what is gone in every pair: the answers of `detect`, computed in one batch.

    A pair that has no answer gets a result of status `failed` with the reason in its place; the others are not
    touched. A batch that breaks is halved until the pair that broke it is alone.
    """
    config = config or Config()
    failures = [_failure(pair) for pair in pairs]
    usable = [pair for pair, failure in zip(pairs, failures, strict=True) if failure is None]
    results = iter(_detect_resiliently(usable, config))
    return [
        next(results) if failure is None else _failed(pair, failure)
        for pair, failure in zip(pairs, failures, strict=True)
    ]


def _detect_resiliently(pairs: list[ScanPair], config: Config) -> list[NoveltyResult]:
    if not pairs:
        return []
    try:
        return _detect_usable(pairs, config)
    except NoveltyError:
        raise
    except Exception as error:
        if len(pairs) == 1:
            _log.exception("pair %r", pairs[0].name)
            return [_failed(pairs[0], f"{type(error).__name__}: {error}")]
    middle = len(pairs) // 2
    return _detect_resiliently(pairs[:middle], config) + _detect_resiliently(pairs[middle:], config)


def _detect_usable(pairs: list[ScanPair], config: Config) -> list[NoveltyResult]:
    clock = Clock()
    # Section 2.2: both scans of every pair, simplified, without outliers and ground.
    with clock.stage("preprocess"):
        batch = prepare_pairs(pairs, config.preprocess, config.unit)
    plan = FitPlan(settings=config.fit, max_components=config.max_components, seed=config.seed)
    return compare_prepared(pairs, batch, plan, config, clock)


def compare_prepared(
    pairs: Sequence[ScanPair], batch: PreparedPairs, plan: FitPlan, config: Config, clock: Clock
) -> list[NoveltyResult]:
    """Register, fit, compare and segment pairs that have been preprocessed.

    Args:
        pairs: The P pairs as given.
        batch: The same, preprocessed.
        plan: How to fit them.
        config: Settings of everything else.
        clock: Counts the seconds of every stage.
    """
    # Section 4, future work: the given poses refined, what remains of their error measured.
    with clock.stage("register"):
        registrations = register(batch, config.registration)
        batch = batch.aligned(registrations.transforms, registrations.residual)
    # Section 2.3: Gaussian mixtures, their order chosen by MDL (Algorithm 1).
    with clock.stage("fit"):
        models = config.chosen_detector.fit(batch, plan)
    results = compare_fitted(pairs, batch, registrations, models, config, clock)
    timings = {stage: seconds / len(pairs) for stage, seconds in clock.seconds.items()}
    return [replace(result, timings=timings) for result in results]


def compare_fitted(
    pairs: Sequence[ScanPair],
    batch: PreparedPairs,
    registrations: Registrations,
    models: Models,
    config: Config,
    clock: Clock,
    measured: Measured | None = None,
) -> list[NoveltyResult]:
    """Compare and segment pairs whose mixtures are known; the results have no timings.

    Args:
        pairs: The P pairs as given.
        batch: The same, preprocessed, in one frame.
        registrations: What brought them into that frame.
        models: Their mixtures, as the detector of `config` fits them.
        config: Settings of the detector and of everything after it.
        clock: Counts the seconds of every stage.
        measured: Keeps what no detector has a say in for the next call with this batch.
    """
    detector = config.chosen_detector
    measured = {} if measured is None else measured
    # Section 2.4: which components have no counterpart in the other mixture.
    with clock.stage("compare"):
        comparison = detector.compare(batch, models)
    # Algorithm 2, line 10: the points of those components; then what lies inside them and behind them.
    with clock.stage("segment"):
        added = segment_current(batch, models, comparison.added, config, measured)
        removed = segment_current(batch.exchanged(), models.exchanged(), comparison.removed, config, measured)
    with clock.stage("objects"):
        notes = blind_notes(batch.reference, batch.current) if _asks_visibility(config) else [()] * len(pairs)
        notes = [
            told + more for told, more in zip(notes, _chance_notes(batch, measured, config), strict=True)
        ]
        outcome = PairOutcome(
            batch, registrations, models, comparison, added, removed, notes, config.preprocess.up
        )
        return assemble(pairs, outcome, config.unit)


def segment_current(
    batch: PreparedPairs,
    models: Models,
    novelty: ComponentNovelty | PointNovelty,
    config: Config,
    measured: Measured | None = None,
) -> SegmentedPoints:
    """Label the points of the current scans: by component, refined, and judged by what the reference could see.

    Labels that a baseline gave are not refined; those it gave point by point stay as they are, and only visibility
    judges them, when asked to.
    """
    scans, others = batch.current, batch.reference
    resolution = batch.resolution
    visible = _asks_visibility(config)
    if isinstance(novelty, PointNovelty):
        segmented = label_points(scans.points, novelty)
        return judge(segmented, scans, others, resolution, config.visibility) if visible else segmented
    segmented = segment_points(scans.points, models.current.mixtures, novelty, config.segment)
    refined = _asks_refinement(config)
    chance_groups = None
    if refined:
        measured, key = {} if measured is None else measured, (id(scans), config.refine)
        if key not in measured:
            measured[key] = measure_off_surface(scans, others, resolution, config.refine)
        segmented = refine(segmented, scans, measured[key], config.refine)
        chance_groups = measured[key].chance_groups
    if visible:
        segmented = judge(segmented, scans, others, resolution, config.visibility)
    if refined:
        segmented = drop_measured(segmented, scans, others, resolution)
    return drop_specks(segmented, scans, config.segment, chance_groups)


def _chance_notes(batch: PreparedPairs, measured: Measured, config: Config) -> list[tuple[str, ...]]:
    """For each pair, from which size on groups of points counted where that is more than was asked for."""
    notes: list[tuple[str, ...]] = [()] * len(batch)
    if not _asks_refinement(config):
        return notes
    for role, scans in (("reference", batch.reference), ("current", batch.current)):
        for row, size in enumerate(measured[id(scans), config.refine].chance_groups.tolist()):
            if size >= config.segment.min_points:
                note = (
                    f"{role} scan: groups of up to {size} points were taken for chance, since it shows as large ones "
                    "against itself; give the other sensor's position to find smaller things."
                )
                notes[row] = (*notes[row], note)
    return notes


def _asks_refinement(config: Config) -> bool:
    return config.refine.method != "none" and config.chosen_detector.asks_refinement


def _asks_visibility(config: Config) -> bool:
    return config.visibility.method != "none" and config.chosen_detector.asks_visibility


def _failure(pair: ScanPair) -> str | None:
    try:
        check_scan(pair.reference)
        check_scan(pair.current)
    except InputError as error:
        return str(error)
    return None


def _failed(pair: ScanPair, reason: str) -> NoveltyResult:
    return NoveltyResult(
        name=pair.name,
        changed=False,
        p_value=float("nan"),
        distance=float("nan"),
        status=ResultStatus.FAILED,
        message=reason,
        timings={},
        added=Change.not_examined(pair.current.num_points),
        removed=Change.not_examined(pair.reference.num_points),
    )


class Clock:
    """Wall seconds per stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside."""
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start
