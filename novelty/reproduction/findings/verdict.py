"""A verdict rests on quantities with intervals, each beside the bound that a sentence of the paper sets for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from novelty.evaluation import Interval


class Verdict(StrEnum):
    """How our numbers stand to a sentence of the paper."""

    AGREES = "agrees"
    PARTLY = "partly"
    DIFFERS = "differs"
    OPEN = "open"


@dataclass(frozen=True)
class Condition:
    """A quantity that has to be above some bound, or between two, for a sentence to hold.

    Attributes:
        what: The quantity.
        span: Its mean and 95 % interval.
        low: It has to be greater than this.
        high: It has to be less than this.
    """

    what: str
    span: Interval
    low: float = -math.inf
    high: float = math.inf

    @property
    def holds(self) -> bool | None:
        """Whether the whole interval is inside the bounds, or outside; None when it lies on a bound."""
        low, high = self.span.low, self.span.high
        if self.span.count == 0 or math.isnan(low):
            return None
        if self.low < low and high < self.high:
            return True
        if high <= self.low or low >= self.high:
            return False
        return None

    def __str__(self) -> str:
        if math.isinf(self.high):
            bound = f"> {self.low:.2g}"
        elif math.isinf(self.low):
            bound = f"< {self.high:.2g}"
        else:
            bound = f"in {self.low:g} to {self.high:g}"
        return f"{self.what} {told(self.span)} ({bound})"


def judged(conditions: Sequence[Condition]) -> Verdict:
    """All hold: agrees; none holds and at least one fails: differs; some hold: partly; else nothing is decided."""
    held = [condition.holds for condition in conditions]
    if all(held):
        return Verdict.AGREES
    if any(held):
        return Verdict.PARTLY
    return Verdict.DIFFERS if False in held else Verdict.OPEN


def told(span: Interval) -> str:
    """0.43 [0.31, 0.55]."""
    if math.isnan(span.mean):
        return "not defined"
    mean, low, high = (round(value, 2) + 0.0 for value in (span.mean, span.low, span.high))  # never -0.00
    return f"{mean:.2f}" if math.isnan(low) else f"{mean:.2f} [{low:.2f}, {high:.2f}]"
