"""The metrics of a contingency table, as a table that sweeps and reports iterate.

Vieira Neto & Nehmzow (2008) use Cramer's V, the uncertainty coefficient U and the index of agreement kappa
(section 3.1); the rest is what the change-detection literature reports. A value is NaN where it is 0/0, and
where the ground truth has one class only, so that there was nothing to find or nothing to leave alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from novelty.evaluation.contingency import ContingencyTable


@dataclass(frozen=True)
class Metric:
    """One line of the table.

    Attributes:
        name: Its key in `Scores` and in every file of results.
        description: What a reader of a report needs to know.
        function: From a contingency table to the value, NaN where it is not defined.
        better: Whether higher or lower values are better.
    """

    name: str
    description: str
    function: Callable[[ContingencyTable], float]
    better: Literal["higher", "lower"]


def kappa(table: ContingencyTable) -> float:
    """2 (AD - BC) / [(A+C)(C+D) + (A+B)(B+D)], Cohen's kappa, in [-1, 1]; section 3.1.

    Equals `sklearn.metrics.cohen_kappa_score`. A system that calls nothing novel scores 0.
    """
    denominator = table.called_novel * table.not_novel + table.novel * table.not_called_novel
    return _two_class_ratio(table, 2 * table.determinant, denominator)


def chi2(table: ContingencyTable) -> float:
    """Chi-squared = n (AD - BC)^2 / [(A+B)(C+D)(A+C)(B+D)], Pearson's, 1 degree of freedom; section 3.1.

    Equals `scipy.stats.chi2_contingency(table, correction=False).statistic`.
    """
    return _two_class_ratio(table, table.total * table.determinant**2, _product_of_margins(table))


def log_p_value(table: ContingencyTable) -> float:
    """Natural logarithm of `p_value`, exact where that underflows."""
    from scipy.special import log_ndtr

    # X is the square of a standard normal variable, whose two tails have a logarithm that does not underflow.
    return math.log(2) + float(log_ndtr(-math.sqrt(chi2(table))))


def p_value(table: ContingencyTable) -> float:
    """P(X >= chi2) for X chi-squared with 1 degree of freedom; equals `scipy.stats.chi2.sf(chi2, 1)`."""
    return math.exp(log_p_value(table))


def cramers_v(table: ContingencyTable) -> float:
    """V = sqrt(chi2 / n), Cramer's V, in [0, 1]; section 3.1."""
    return math.sqrt(chi2(table) / table.total) if table.total else math.nan


def uncertainty(table: ContingencyTable) -> float:
    """U = 2 [H(x) + H(y) - H(x, y)] / [H(x) + H(y)], the uncertainty coefficient, in [0, 1]; section 3.1.

    Symmetric in truth and response; twice the mutual information over the sum of the entropies, in any unit.
    """
    if table.total == 0:
        return math.nan
    entropies = _entropy(table.novel, table.total) + _entropy(table.called_novel, table.total)
    return _two_class_ratio(table, 2 * _mutual_information(table), entropies)


def mcc(table: ContingencyTable) -> float:
    """(AD - BC) / sqrt[(A+B)(C+D)(A+C)(B+D)], Matthews' correlation: V with a sign.

    Equals `sklearn.metrics.matthews_corrcoef`, which says 0 where this is not defined.
    """
    return _two_class_ratio(table, table.determinant, math.sqrt(_product_of_margins(table)))


def precision(table: ContingencyTable) -> float:
    """A / (A+C): the share of the points called novel that are."""
    return _ratio(table.true_positives, table.called_novel)


def recall(table: ContingencyTable) -> float:
    """A / (A+B): the share of the novel points that were called so."""
    return _ratio(table.true_positives, table.novel)


def f1(table: ContingencyTable) -> float:
    """2A / (2A+B+C): the harmonic mean of precision and recall."""
    errors = table.false_negatives + table.false_positives
    return _ratio(2 * table.true_positives, 2 * table.true_positives + errors) if table.novel else math.nan


def iou(table: ContingencyTable) -> float:
    """A / (A+B+C): intersection over union of the points that are novel and those called so."""
    union = table.novel + table.false_positives
    return _ratio(table.true_positives, union) if table.novel else math.nan


METRICS = (
    Metric("kappa", "index of agreement, Cohen's kappa", kappa, "higher"),
    Metric("cramers_v", "strength of association, Cramer's V", cramers_v, "higher"),
    Metric("uncertainty", "uncertainty coefficient U: shared entropy", uncertainty, "higher"),
    Metric("chi2", "chi-squared of the table, 1 degree of freedom", chi2, "higher"),
    Metric("p_value", "probability of so strong an association by chance", p_value, "lower"),
    Metric("precision", "share of the points called novel that are", precision, "higher"),
    Metric("recall", "share of the novel points that were found", recall, "higher"),
    Metric("f1", "harmonic mean of precision and recall", f1, "higher"),
    Metric("iou", "intersection over union of the novel points", iou, "higher"),
    Metric("mcc", "Matthews' correlation coefficient", mcc, "higher"),
)
"""A new metric is one function, one line here and one field of `Scores`."""


def _product_of_margins(table: ContingencyTable) -> int:
    return table.novel * table.not_novel * table.called_novel * table.not_called_novel


def _mutual_information(table: ContingencyTable) -> float:
    """I(x; y) = sum_ij (n_ij / n) ln[n n_ij / (r_i c_j)] in nats, r and c the margins; never negative."""
    cells = (
        (table.true_positives, table.novel * table.called_novel),
        (table.false_negatives, table.novel * table.not_called_novel),
        (table.false_positives, table.not_novel * table.called_novel),
        (table.true_negatives, table.not_novel * table.not_called_novel),
    )
    total = table.total
    return max(
        math.fsum(count / total * _log_ratio(total * count, by_chance) for count, by_chance in cells), 0.0
    )


def _entropy(count: int, total: int) -> float:
    """H in nats of two classes of `count` and `total - count` points."""
    return -sum(size / total * _log_ratio(size, total) for size in (count, total - count))


def _log_ratio(numerator: int, denominator: int) -> float:
    """Natural logarithm of a ratio of counts, exact near 1 too, where a tiny class would drown; 0 of none."""
    if numerator == 0:
        return 0.0
    if denominator < 2 * numerator < 4 * denominator:
        return math.log1p((numerator - denominator) / denominator)
    return math.log(numerator / denominator)


def _two_class_ratio(table: ContingencyTable, numerator: float, denominator: float) -> float:
    both_classes = table.novel > 0 and table.not_novel > 0
    return _ratio(numerator, denominator) if both_classes else math.nan


def _ratio(numerator: float, denominator: float) -> float:
    return float(numerator / denominator) if denominator else math.nan
