"""Scores of answers against ground truth, as the rows of a table and of a file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.table import Table

from novelty.cli.terminal import plain_table
from novelty.result import NoveltyResult
from novelty.scan import ScanPair

if TYPE_CHECKING:
    from novelty.evaluation import LabelledScores

COLUMNS = {
    "kappa_added": "kappa\nadded",
    "kappa_removed": "kappa\nremov.",
    "kappa": "kappa\nmean",
    "cramers_v": "V",
    "uncertainty": "U",
    "f1": "F1",
    "iou": "IoU",
    "seen_once_called_novel": "seen\nonce",
    "seconds": "time\n(s)",
}
"""Keys of a row's numbers and their headings; where no direction is named, the mean of both."""


@dataclass(frozen=True)
class ScoredPair:
    """What one detector scored on one pair.

    Attributes:
        name: Of the pair.
        detector: Its name.
        values: One number per key of `COLUMNS`, NaN where not defined; empty when the pair failed.
        failure: Why there are no scores; empty when there are.
    """

    name: str
    detector: str
    values: Mapping[str, float]
    failure: str = ""

    @property
    def any_defined(self) -> bool:
        """Whether there is any score; where nothing changed and nothing was called novel there may be none."""
        return any(not math.isnan(value) for key, value in self.values.items() if key != "seconds")


def score_result(pair: ScanPair, result: NoveltyResult) -> dict[str, LabelledScores]:
    """Agreement with the ground truth for `added` and `removed`, for the scans that have labels."""
    from novelty.evaluation import evaluate_labels

    sides = (("added", pair.current, result.added), ("removed", pair.reference, result.removed))
    return {
        direction: evaluate_labels(scan.labels, change.point_labels)
        for direction, scan, change in sides
        if scan.labels is not None
    }


def scored_pair(detector: str, result: NoveltyResult, scores: Mapping[str, LabelledScores]) -> ScoredPair:
    """One row: the kappa of both directions and the mean over them of everything else."""
    kappas = {direction: labelled.scores.kappa for direction, labelled in scores.items()}
    values = {
        "kappa_added": kappas.get("added", math.nan),
        "kappa_removed": kappas.get("removed", math.nan),
        "kappa": mean(kappas.values()),
        **{
            metric: mean(getattr(labelled.scores, metric) for labelled in scores.values())
            for metric in ("cramers_v", "uncertainty", "f1", "iou")
        },
        "seen_once_called_novel": mean(labelled.seen_once_called_novel for labelled in scores.values()),
        "seconds": sum(result.timings.values()),
    }
    return ScoredPair(result.name, detector, values)


def mean(values: Iterable[float]) -> float:
    """Mean of the defined values; NaN when none is."""
    defined = [value for value in values if not math.isnan(value)]
    return sum(defined) / len(defined) if defined else math.nan


def mean_row(rows: Sequence[ScoredPair]) -> dict[str, float]:
    """Mean of every column over the pairs where it is defined."""
    return {key: mean(row.values[key] for row in rows if row.values) for key in COLUMNS}


def score_table(first: str) -> Table:
    """An empty table of scores; `first` heads the column that names the rows."""
    table = plain_table(gap=1)
    table.add_column(first, overflow="fold", vertical="bottom", min_width=19)
    for heading in COLUMNS.values():
        table.add_column(heading, justify="right", vertical="bottom", no_wrap=True)
    return table


def cells(values: Mapping[str, float]) -> list[str]:
    """The numbers of a row as text, a dash where not defined."""
    return [
        "–" if math.isnan(values[key]) else f"{values[key]:.{2 if key == 'seconds' else 3}f}"
        for key in COLUMNS
    ]
