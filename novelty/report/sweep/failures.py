"""Runs without an answer, and runs with notes, grouped by what they say."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.report.answer import note_lines
from novelty.report.sweep.runs import SweepRuns


@dataclass(frozen=True)
class Reason:
    """What several runs say alike.

    Attributes:
        status: Of the runs.
        message: Of the first of them.
        num_runs: How many runs say so.
        pairs: The pairs concerned, the first ones.
        num_pairs: How many pairs are concerned.
    """

    status: str
    message: str
    num_runs: int
    pairs: tuple[str, ...]
    num_pairs: int


SHOWN_PAIRS = 5


def failures(runs: SweepRuns) -> list[Reason]:
    """The reasons of runs without an answer, the most frequent first."""
    return _reasons(runs, np.flatnonzero(runs.failed))


def remarks(runs: SweepRuns) -> list[Reason]:
    """What the other runs have to say beside their answer, the most frequent first."""
    said = runs.texts("message") != ""
    return _reasons(runs, np.flatnonzero(said & ~runs.failed))


def _reasons(runs: SweepRuns, rows: NDArray[np.int64]) -> list[Reason]:
    """Messages that differ in numbers and files only are one reason."""
    messages, names, statuses = runs.texts("message"), runs.texts("pair"), runs.texts("status")
    groups: dict[tuple[str, str], list[int]] = {}
    pattern_of: dict[str, str] = {}
    for row in rows:
        pattern = pattern_of.setdefault(messages[row], _pattern(messages[row]))
        groups.setdefault((statuses[row], pattern), []).append(int(row))
    found = []
    for (status, _), members in groups.items():
        pairs = tuple(dict.fromkeys(names[members]))
        told = "\n".join(note_lines(messages[members[0]]))
        found.append(Reason(status, told, len(members), pairs[:SHOWN_PAIRS], len(pairs)))
    return sorted(found, key=lambda reason: -reason.num_runs)


def _pattern(message: str) -> str:
    return re.sub(r"\S*[/\d]\S*", "#", message)
