"""Calls that take turns, and the line of the table that their times make."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """One line of the table: what, our median and the peer's (s), and a remark on the quality of the results."""

    what: str
    ours: float
    peer: str
    theirs: float
    remark: str = ""

    def __str__(self) -> str:
        ratio = self.ours / self.theirs
        return f"{self.what:<62} {self.ours:9.3f} {self.theirs:9.3f}  {ratio:6.3f}  {self.peer:<22} {self.remark}"


HEADER = f"{'':<62} {'ours (s)':>9} {'peer (s)':>9}  {'ratio':>6}  peer"


def alternate(ours: Callable[[], object], peer: Callable[[], object], runs: int) -> tuple[float, float]:
    """Median times of two calls that take turns, after one warm-up each (s)."""
    times: tuple[list[float], list[float]] = ([], [])
    for run in range(runs + 1):
        for call, kept in zip((ours, peer), times, strict=True):
            seconds = timed(call)
            if run:
                kept.append(seconds)
    return statistics.median(times[0]), statistics.median(times[1])


def timed(call: Callable[[], object]) -> float:
    """Seconds of one call."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start
