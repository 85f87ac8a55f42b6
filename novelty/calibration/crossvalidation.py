"""Settings chosen on some of the pairs and scored on the others, then chosen once more on all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty.calibration.fitted import FittedPair, kappa
from novelty.calibration.grids import GRIDS, settings_of
from novelty.calibration.pairings import pairings_of
from novelty.calibration.thresholds import least_error_thresholds
from novelty.config import Config
from novelty.errors import ConfigError, InputError
from novelty.evaluation import Interval, bootstrap_interval

Settings = dict[str, Any]
"""Dotted keys of a configuration and their values."""

Choice = tuple[Settings, tuple[str, ...]]
"""Settings, and what is to be said of them."""

Chooser = Callable[[Sequence[int]], Choice]
"""From the places of the pairs that may be looked at to the settings that suit them."""

MOST_FOLDS = 10
"""Up to this many pairs each is a fold of its own."""

STRUCTURAL = "structural_matching"


@dataclass(frozen=True, eq=False)
class Calibration:
    """What was chosen and what it is worth.

    Attributes:
        names: The pairs.
        settings: Chosen on all pairs, dotted keys.
        chosen: For each fold, what was chosen on the pairs outside it.
        folds: (P,) the fold of each pair.
        before: (P,) kappa of each pair with the configuration as given.
        after: (P,) kappa of each pair with what was chosen without it.
        notes: What is to be said of the settings, such as that larger thresholds serve as well.
    """

    names: tuple[str, ...]
    settings: Settings
    chosen: tuple[Settings, ...]
    folds: NDArray[np.int64]
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    notes: tuple[str, ...] = ()

    @property
    def gain(self) -> Interval:
        """Mean gain in kappa on held-out pairs, with a bootstrap interval over the pairs."""
        return bootstrap_interval(self.after - self.before)

    @property
    def gained(self) -> bool:
        """Whether held-out pairs gained anything; if not, the settings as given are the better choice."""
        return self.gain.mean > 0


def calibrate(pairs: Sequence[FittedPair], config: Config, num_folds: int | None = None) -> Calibration:
    """Choose the settings of `config.detector` on labelled pairs.

    U_T and U_R of `structural_matching` minimise the probability of error (section 3.2), the other detectors take the
    combination of `GRIDS` with the highest mean kappa; the given settings stay unless others have a higher kappa.

    Args:
        pairs: At least two, fitted under `config`.
        config: The configuration to start from.
        num_folds: Of the cross-validation; None: one per pair up to ten pairs, else ten.

    Raises:
        InputError: Fewer pairs or folds than two.
        ConfigError: The detector has nothing to calibrate.
    """
    if len(pairs) < 2:
        raise InputError(
            f"calibration holds pairs out to measure what it gained, so it needs two at least; found {len(pairs)}."
        )
    folds = _folds(len(pairs), num_folds)
    scores = _Scores(pairs, config)
    choose = _chooser(pairs, config, scores)
    chosen = tuple(choose(np.flatnonzero(folds != fold).tolist())[0] for fold in range(folds.max() + 1))
    settings, notes = choose(range(len(pairs)))
    return Calibration(
        names=tuple(fitted.pair.name for fitted in pairs),
        settings=settings,
        chosen=chosen,
        folds=folds,
        before=np.array([scores.of(row, {}) for row in range(len(pairs))]),
        after=np.array([scores.of(row, chosen[fold]) for row, fold in enumerate(folds.tolist())]),
        notes=notes,
    )


def _folds(num_pairs: int, num_folds: int | None) -> NDArray[np.int64]:
    """The fold of every pair (P,): pairs that stand together in the manifest are spread over the folds."""
    count = min(num_pairs, MOST_FOLDS) if num_folds is None else num_folds
    if not 2 <= count <= num_pairs:
        raise InputError(
            f"the number of folds must lie between 2 and the number of pairs, {num_pairs}; got {count}."
        )
    return np.arange(num_pairs) % count


class _Scores:
    """Kappa of pairs under settings, each computed once."""

    def __init__(self, pairs: Sequence[FittedPair], config: Config) -> None:
        self.pairs = pairs
        self.config = config
        self.known: dict[tuple[int, tuple[Any, ...]], float] = {}

    def of(self, row: int, settings: Settings) -> float:
        """Kappa of one pair."""
        key = (row, tuple(sorted(settings.items())))
        if key not in self.known:
            config = self.config.replace(**settings) if settings else self.config
            self.known[key] = kappa(self.pairs[row], config)
        return self.known[key]

    def mean(self, rows: Sequence[int], settings: Settings) -> float:
        """Mean over some pairs where it is defined; -inf where it is nowhere."""
        values = [value for row in rows if not math.isnan(value := self.of(row, settings))]
        return sum(values) / len(values) if values else -math.inf


def _chooser(pairs: Sequence[FittedPair], config: Config, scores: _Scores) -> Chooser:
    if config.detector == STRUCTURAL:
        return _by_least_error(pairs, config, scores)
    if config.detector not in GRIDS:
        known = ", ".join([STRUCTURAL, *GRIDS])
        raise ConfigError(f"the detector {config.detector!r} has nothing to calibrate; choose from {known}.")
    # The given settings first: among equals `max` takes the first.
    candidates = [_given(config), *settings_of(config.detector)]
    return lambda rows: (max(candidates, key=lambda settings: scores.mean(rows, settings)), ())


def _given(config: Config) -> Settings:
    """The given values of what the grid varies."""
    section = config.to_mapping()[config.detector]
    return {f"{config.detector}.{key}": section[key] for key in GRIDS[config.detector]}


def _by_least_error(pairs: Sequence[FittedPair], config: Config, scores: _Scores) -> Chooser:
    """Least probability of error; the given thresholds stay where these have a higher kappa on the same pairs."""
    pairings = [pairings_of(fitted, config.structural_matching) for fitted in pairs]
    given = config.structural_matching
    stay = _thresholds(given.node_threshold, given.arc_threshold)

    def choose(rows: Sequence[int]) -> Choice:
        found = least_error_thresholds([pairings[row] for row in rows])
        learnt = _thresholds(found.node, found.arc)
        if scores.mean(rows, learnt) > scores.mean(rows, stay):
            return learnt, found.notes
        return stay, ()

    return choose


def _thresholds(node: float, arc: float) -> Settings:
    return {f"{STRUCTURAL}.node_threshold": node, f"{STRUCTURAL}.arc_threshold": arc}
