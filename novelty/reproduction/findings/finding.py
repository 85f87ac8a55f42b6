"""One sentence of the paper beside our numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from novelty.evaluation import Interval
from novelty.reproduction.findings.verdict import Condition, Verdict, judged
from novelty.reproduction.methods import CALIBRATED, EMD, Method
from novelty.reproduction.rows import Row, interval, matching

ALMOST_COMPLETE, STRONG, NO = 0.8, 0.6, 0.1
"""Kappas above which Table 1 calls agreement almost complete or strong, and up to which there is none."""

ALIKE = 0.1
"""Mean kappas nearer than this are called the same: half a level of Table 1."""

SECOND = (EMD, CALIBRATED)
"""The printed methods in the second reading, with U_T and U_R as found here."""


@dataclass(frozen=True)
class Finding:
    """One sentence of the paper beside our numbers.

    Attributes:
        claim: What the paper says, and where.
        printed: Its numbers.
        ours: What ours say.
        decides: The quantities on which the verdict rests, each with its 95 % interval and the bound it has to meet.
        verdict: How they agree, for the methods as printed.
        second_decides: The same quantities with U_T and U_R as found here; empty where no such method is meant.
        second_verdict: How they agree then; empty likewise.
    """

    claim: str
    printed: str
    ours: str
    decides: str
    verdict: Verdict
    second_decides: str = ""
    second_verdict: str = ""


def weighed(
    claim: str,
    printed: str,
    ours: str,
    conditions: Sequence[Condition],
    second: Sequence[Condition] = (),
) -> Finding:
    """The finding whose verdicts the conditions give, for the printed methods and for the second reading."""
    return Finding(
        claim,
        printed,
        ours,
        "; ".join(map(str, conditions)),
        judged(conditions),
        "; ".join(map(str, second)),
        judged(second) if second else "",
    )


def by_case(rows: Sequence[Row], column: str = "kappa") -> dict[str, Interval]:
    """Mean and interval of a column for every case."""
    cases = dict.fromkeys(row.case for row in rows)
    return {case: interval(matching(rows, case=case), column) for case in cases}


def of_methods(rows: Sequence[Row], methods: Iterable[Method]) -> str:
    """Mean kappa of every method in every case, as text."""
    return "; ".join(
        f"{method.title}: κ {listed(by_case(matching(rows, method=method.key)))}" for method in methods
    )


def listed(spans: Mapping[str, Interval]) -> str:
    """Means by name: cylinder 0.25, person 0.99."""
    return ", ".join(f"{name} {round(span.mean, 2) + 0.0:.2f}" for name, span in spans.items())
