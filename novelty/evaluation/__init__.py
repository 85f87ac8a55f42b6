"""How well an answer agrees with the ground truth (section 3.1)."""

from novelty.evaluation.contingency import ContingencyTable
from novelty.evaluation.labels import LabelledScores, evaluate_labels
from novelty.evaluation.metrics import METRICS, Metric
from novelty.evaluation.scores import Agreement, Scores, evaluate

__all__ = [
    "METRICS",
    "Agreement",
    "ContingencyTable",
    "LabelledScores",
    "Metric",
    "Scores",
    "evaluate",
    "evaluate_labels",
]
