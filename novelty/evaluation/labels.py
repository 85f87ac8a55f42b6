"""Scoring against the ground-truth labels of a scan."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from novelty.errors import InputError
from novelty.evaluation.scores import Scores, evaluate
from novelty.scan import AMBIGUOUS, CHANGED, SEEN_ONCE, UNCHANGED


@dataclass(frozen=True)
class LabelledScores:
    """Scores of one scan against its labels.

    Attributes:
        scores: On the points labelled unchanged or changed.
        num_seen_once: Points seen in one scan only (label 2), which are reported apart.
        seen_once_called_novel: The share of those that was called novel; NaN when there are none. Lower is
            better: what was hidden is not new.
        num_ambiguous: Points that are not scored (label 255).
    """

    scores: Scores
    num_seen_once: int
    seen_once_called_novel: float
    num_ambiguous: int


def evaluate_labels(labels: ArrayLike, predicted: ArrayLike) -> LabelledScores:
    """Score the points called novel against `Scan.labels`.

    Args:
        labels: Ground truth (N,): 0 unchanged, 1 changed, 2 seen in one scan only, 255 ambiguous.
        predicted: Whether each point was called novel, bool (N,).

    Raises:
        InputError: The lengths differ, or an array holds other values.
    """
    values = np.asarray(labels)
    if not np.isin(values, (UNCHANGED, CHANGED, SEEN_ONCE, AMBIGUOUS)).all():
        raise InputError(f"labels must be 0, 1, 2 or 255; found {np.unique(values)[:8].tolist()}.")
    scores = evaluate(values == CHANGED, predicted, ignore=values >= SEEN_ONCE)
    seen_once = values == SEEN_ONCE
    num_seen_once = int(seen_once.sum())
    called_novel = int(np.asarray(predicted, dtype=bool)[seen_once].sum())
    share = called_novel / num_seen_once if num_seen_once else math.nan
    return LabelledScores(scores, num_seen_once, share, int((values == AMBIGUOUS).sum()))
