"""Everything that is calculated of a sweep, in one place for all kinds of reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from novelty.report.sweep.costs import Costs, costs
from novelty.report.sweep.extremes import Extreme, extremes
from novelty.report.sweep.orders import Orders, orders
from novelty.report.sweep.record import SweepRecord
from novelty.report.sweep.runs import SweepRuns
from novelty.report.sweep.studies import Study, studies
from novelty.report.sweep.summary import METRICS


@dataclass(frozen=True, eq=False)
class SweepAnalysis:
    """What a report says about a sweep.

    Attributes:
        runs: The rows.
        record: How they came about.
        metrics: The scores and what readers call them, those that the sweep names first.
        studies: Scores against each factor.
        orders: What the order search did.
        costs: Where the time went.
        ends: The worst and the best runs; empty without scores.
    """

    runs: SweepRuns
    record: SweepRecord
    metrics: Mapping[str, str]
    studies: list[Study]
    orders: Orders
    costs: Costs
    ends: list[Extreme]

    @classmethod
    def of(cls, runs: SweepRuns) -> SweepAnalysis:
        """Calculate it all."""
        record, cut = SweepRecord.read(runs.root), studies(runs)
        named = [metric for metric in record.metrics if metric in METRICS]
        metrics = {metric: METRICS[metric] for metric in dict.fromkeys([*named, *METRICS])}
        return cls(runs, record, metrics, cut, orders(runs, cut[0]), costs(runs, cut[0]), extremes(runs))

    @property
    def scored(self) -> list[Study]:
        """The studies that have a score, that is where there was a ground truth."""
        return [study for study in self.studies if study.scored]
