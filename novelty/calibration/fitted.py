"""A labelled pair, preprocessed, registered and fitted once, to be compared with many settings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from novelty.config import Config
from novelty.errors import InputError
from novelty.evaluation import evaluate_labels
from novelty.fitting import FitPlan, Models
from novelty.pipeline import segment_current
from novelty.preprocess import PreparedPairs, PreparedScans, check_scan, prepare_pairs
from novelty.registration import register
from novelty.scan import CHANGED, Scan, ScanPair
from novelty.segment import SegmentedPoints


@dataclass(frozen=True, eq=False)
class FittedPair:
    """What the stages before the comparison made of one pair.

    Attributes:
        pair: The scans as given, with labels.
        batch: The same, preprocessed and aligned: a batch of one.
        models: The mixtures.
    """

    pair: ScanPair
    batch: PreparedPairs
    models: Models


def fit_pair(pair: ScanPair, config: Config) -> FittedPair:
    """Run the stages before the comparison.

    Raises:
        InputError: The pair cannot be used: labels are missing or name no change, or a scan has no answer.
    """
    _check_labels(pair)
    for scan in (pair.reference, pair.current):
        check_scan(scan)
    batch = prepare_pairs([pair], config.preprocess, config.unit)
    registrations = register(batch, config.registration)
    batch = batch.aligned(registrations.transforms, registrations.residual)
    plan = FitPlan(settings=config.fit, max_components=config.max_components, seed=config.seed)
    return FittedPair(pair, batch, config.chosen_detector.fit(batch, plan))


def kappa(fitted: FittedPair, config: Config) -> float:
    """Mean kappa of what is called added and removed under other settings of the comparison.

    Equals the kappa of `novelty.detect` with these settings, for those that act after the fit. A direction without
    any change in truth and answer has no kappa and is left out; NaN when neither has one.
    """
    batch, models = fitted.batch, fitted.models
    comparison = config.chosen_detector.compare(batch, models)
    added = segment_current(batch, models, comparison.added, config)
    removed = segment_current(batch.exchanged(), models.exchanged(), comparison.removed, config)
    values = [
        _kappa(fitted.pair.current, batch.current, added),
        _kappa(fitted.pair.reference, batch.reference, removed),
    ]
    defined = [value for value in values if not np.isnan(value)]
    return float(np.mean(defined)) if defined else float("nan")


def _kappa(scan: Scan, prepared: PreparedScans, segmented: SegmentedPoints) -> float:
    called = np.zeros(scan.num_points, dtype=bool)
    called[prepared.kept[0]] = segmented.labels.numpy()
    assert scan.labels is not None  # checked before the fit
    return evaluate_labels(scan.labels, called).scores.kappa


def _check_labels(pair: ScanPair) -> None:
    labels = []
    for role, scan in (("reference", pair.reference), ("current", pair.current)):
        if scan.labels is None:
            raise InputError(
                f"pair {pair.name!r}: the {role} scan carries no ground truth (a `label` per vertex); "
                "calibration needs it in both scans."
            )
        labels.append(scan.labels)
    if not any((values == CHANGED).any() for values in labels):
        raise InputError(
            f"pair {pair.name!r}: no point of either scan is labelled changed (1), so that no setting can be told "
            "from another; leave the pair out."
        )
