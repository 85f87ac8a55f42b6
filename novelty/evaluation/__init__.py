"""How well an answer agrees with the ground truth (section 3.1)."""

from novelty.evaluation.contingency import ContingencyTable
from novelty.evaluation.intervals import (
    Interval,
    McNemar,
    bootstrap_interval,
    mcnemar,
    mcnemar_over_scans,
    proportion_interval,
    t_interval,
)
from novelty.evaluation.labels import LabelledScores, evaluate_labels
from novelty.evaluation.metrics import METRICS, Metric
from novelty.evaluation.scores import Agreement, Scores, evaluate

__all__ = [
    "METRICS",
    "Agreement",
    "ContingencyTable",
    "Interval",
    "LabelledScores",
    "McNemar",
    "Metric",
    "Scores",
    "bootstrap_interval",
    "evaluate",
    "evaluate_labels",
    "mcnemar",
    "mcnemar_over_scans",
    "proportion_interval",
    "t_interval",
]
