"""The pairs that came out worst and best."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.report.sweep.kept import KeptRun, load_kept
from novelty.report.sweep.runs import SweepRuns

SHOWN = 4
"""Pairs at either end at most."""


@dataclass(frozen=True, eq=False)
class Extreme:
    """One run at an end of the scale.

    Attributes:
        row: Of the table.
        end: `worst` or `best`.
        kept: Its labels and mixtures; None where they were not kept.
    """

    row: int
    end: str
    kept: KeptRun | None


def extremes(runs: SweepRuns, metric: str = "kappa") -> list[Extreme]:
    """The worst run of the pairs with the worst runs, then the best of the best; no pair is named twice at an end.

    Of runs that are equally good, those whose labels and mixtures were kept come first.
    """
    scores = runs.numbers(metric)
    scored = np.flatnonzero(~np.isnan(scores))
    kept = np.isin(runs.texts("key"), _kept_keys(runs))
    ends = []
    for end, sign in (("worst", 1), ("best", -1)):
        order = scored[np.lexsort((~kept[scored], sign * scores[scored]))]
        ends += [_extreme(runs, row, end) for row in _first_of_pairs(order, runs.pair_codes)]
    return ends


def _kept_keys(runs: SweepRuns) -> list[str]:
    return [file.stem for file in (runs.root / "results").glob("*.npz")]


def _first_of_pairs(order: NDArray[np.int64], pairs: NDArray[np.int64]) -> list[int]:
    """The first row of each pair, for the first pairs; at most half of all, so that no pair is at both ends."""
    _, firsts = np.unique(pairs[order], return_index=True)
    count = min(SHOWN, -(-len(firsts) // 2))
    return [int(row) for row in order[np.sort(firsts)[:count]]]


def _extreme(runs: SweepRuns, row: int, end: str) -> Extreme:
    inputs, key, settings = (runs.table[column][row].as_py() for column in ("inputs", "key", "configuration"))
    return Extreme(row, end, load_kept(runs.root, inputs, key, json.loads(settings)["unit"]))
