"""How well the points called novel agree with the ground truth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from numpy.typing import ArrayLike

from novelty.evaluation.contingency import ContingencyTable
from novelty.evaluation.metrics import METRICS


class Agreement(StrEnum):
    """Levels of agreement between ground truth and response (Table 1; Vieira Neto & Nehmzow 2008)."""

    NO = "no"
    WEAK = "weak"
    CLEAR = "clear"
    STRONG = "strong"
    ALMOST_COMPLETE = "almost complete"
    UNDEFINED = "undefined"

    @classmethod
    def of(cls, kappa: float) -> Agreement:
        """The level of a kappa: up to 0.1 no, 0.4 weak, 0.6 clear, 0.8 strong, above almost complete."""
        if math.isnan(kappa):
            return cls.UNDEFINED
        limits = ((0.1, cls.NO), (0.4, cls.WEAK), (0.6, cls.CLEAR), (0.8, cls.STRONG))
        return next((level for limit, level in limits if kappa <= limit), cls.ALMOST_COMPLETE)


@dataclass(frozen=True)
class Scores:
    """The metrics of one contingency table; `METRICS` describes each.

    Attributes:
        table: The counts of points behind the metrics.
        level: Level of agreement of kappa (Table 1).
        reasons: Why a metric is NaN, by its name.
    """

    table: ContingencyTable
    kappa: float
    cramers_v: float
    uncertainty: float
    chi2: float
    p_value: float
    precision: float
    recall: float
    f1: float
    iou: float
    mcc: float
    level: Agreement
    reasons: Mapping[str, str]

    @classmethod
    def from_table(cls, table: ContingencyTable) -> Scores:
        """Compute every metric of a table."""
        values = {metric.name: metric.function(table) for metric in METRICS}
        reasons = {name: _reason(name, table) for name, value in values.items() if math.isnan(value)}
        return cls(table=table, level=Agreement.of(values["kappa"]), reasons=reasons, **values)

    def to_dict(self) -> dict[str, float | int | str]:
        """One flat row: the four counts, every metric and the level."""
        counts = {name: getattr(self.table, name) for name in self.table.__dataclass_fields__}
        metrics = {metric.name: getattr(self, metric.name) for metric in METRICS}
        return {**metrics, "level": str(self.level), **counts}


def evaluate(truth: ArrayLike, predicted: ArrayLike, ignore: ArrayLike | None = None) -> Scores:
    """Score the points called novel against the ground truth.

    Args:
        truth: Whether each point is novel, bool (N,).
        predicted: Whether each point was called novel, bool (N,).
        ignore: Points that are not scored, bool (N,); None scores all.

    Raises:
        InputError: The lengths differ, or an array holds something else than truth values.

    Example:
        >>> scores = evaluate([True, True, False, False], [True, False, False, False])
        >>> scores.kappa, scores.precision, scores.recall
        (0.5, 1.0, 0.5)
    """
    return Scores.from_table(ContingencyTable.from_labels(truth, predicted, ignore))


def _reason(metric: str, table: ContingencyTable) -> str:
    """Say which class is empty; the response matters to precision alone, the truth comes first elsewhere."""
    if table.total == 0:
        return "no point is scored"
    if metric == "precision" or (table.novel and table.not_novel):
        return "no point was called novel" if table.called_novel == 0 else "every point was called novel"
    return (
        "no point is novel in the ground truth"
        if table.novel == 0
        else "every point is novel in the ground truth"
    )
