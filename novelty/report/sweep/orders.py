"""The orders that the MDL search chose, and how the description length changes with the order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from novelty.report.sweep.runs import Factor, SweepRuns
from novelty.report.sweep.studies import Study
from novelty.sweep.rows import ROLES

NO_SEARCH = (
    "The order was chosen for both scans of a pair together, so neither scan has a search of its own to show."
)
"""What is said in the place of the paths where there are none."""


@dataclass(frozen=True, eq=False)
class Quartiles:
    """Quartiles along an axis.

    Attributes:
        x: (X,) places on the axis.
        lower: (X,) 25 %.
        middle: (X,) the median.
        upper: (X,) 75 %.
    """

    x: NDArray[np.float64]
    lower: NDArray[np.float64]
    middle: NDArray[np.float64]
    upper: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Orders:
    """What the order search did, per line of the figures (`Study.series_names`).

    Attributes:
        max_components: K_max of the runs that `shares` and `paths` are made of, the largest; None where unknown.
        shares: Share of the scans whose mixture has 1, 2, ... components; those of shared mixtures may exceed K_max.
        paths: Description length above the least of its search, nats, against the order; lines without a search, as
            those of fits that start from another mixture, are left out.
        chosen: K* against K_max; empty where K_max does not vary.
    """

    max_components: int | None
    shares: Mapping[str, NDArray[np.float64]]
    paths: Mapping[str, Quartiles]
    chosen: Mapping[str, Quartiles]


def orders(runs: SweepRuns, study: Study) -> Orders:
    """Read the orders and the paths of both scans of every run; the lines are those of a study."""
    chosen = np.stack([runs.numbers(f"{role}_components") for role in ROLES], axis=1)  # (R, 2)
    chosen = np.where(chosen > 0, chosen, np.nan)
    most = runs.numbers("max_components")
    searched = most[~np.isnan(chosen).all(axis=1)]
    if not len(searched):
        return Orders(None, {}, {}, {})
    largest = int(searched.max())
    lines = study.lines(len(runs))
    widest = {name: rows[most[rows] == largest] for name, rows in lines.items()}
    rises = _rises(runs)
    factor = runs.factor("max_components")
    return Orders(
        largest,
        {name: _shares(chosen[rows]) for name, rows in widest.items()},
        _some(
            {name: _quartiles(rises[:, rows].reshape(-1, rises.shape[2])) for name, rows in widest.items()}
        ),
        {} if factor is None else {name: _by_value(chosen, factor, rows) for name, rows in lines.items()},
    )


def _some(lines: dict[str, Quartiles]) -> dict[str, Quartiles]:
    return {name: line for name, line in lines.items() if len(line.x)}


def _shares(chosen: NDArray[np.float64]) -> NDArray[np.float64]:
    counts = np.bincount(chosen[~np.isnan(chosen)].astype(np.int64))[1:]
    return counts / max(int(counts.sum()), 1)


def _by_value(chosen: NDArray[np.float64], factor: Factor, rows: NDArray[np.int64]) -> Quartiles:
    columns = np.full((2 * len(rows), len(factor.values)), np.nan)
    for place in range(len(factor.values)):
        among = factor.codes[rows] == place
        columns[np.repeat(among, 2), place] = chosen[rows[among]].ravel()
    return _quartiles(columns, np.array(factor.values, dtype=np.float64))


def _rises(runs: SweepRuns) -> NDArray[np.float64]:
    """Description length above the least of each search, nats, (2, R, K_max); NaN where not reached."""
    paths = [_matrix(runs.table[f"{role}_mdl_path"]) for role in ROLES]
    width = max(path.shape[1] for path in paths)
    both = np.stack([np.pad(p, ((0, 0), (0, width - p.shape[1])), constant_values=np.nan) for p in paths])
    searched = (~np.isnan(both)).sum(
        axis=2, keepdims=True
    ) > 1  # an order that was not searched for has no path
    both = np.where(searched, both, np.nan)
    least = np.min(np.where(np.isnan(both), np.inf, both), axis=2, initial=np.inf, keepdims=True)
    return both - np.where(np.isfinite(least), least, np.nan)


def _matrix(column: pa.ChunkedArray) -> NDArray[np.float64]:
    """Lists of different lengths as one array (R, K), NaN beyond their ends."""
    lists = column.combine_chunks()
    lengths = np.nan_to_num(lists.value_lengths().cast(pa.float64()).to_numpy(zero_copy_only=False)).astype(
        int
    )
    flat = lists.flatten().to_numpy(zero_copy_only=False).astype(np.float64)
    matrix = np.full((len(lengths), int(lengths.max(initial=0))), np.nan)
    rows = np.repeat(np.arange(len(lengths)), lengths)
    matrix[rows, np.arange(len(flat)) - np.repeat(np.cumsum(lengths) - lengths, lengths)] = flat
    return matrix


def _quartiles(columns: NDArray[np.float64], x: NDArray[np.float64] | None = None) -> Quartiles:
    """Per column (N, X), of its defined values; columns without any are left out."""
    x = np.arange(1.0, columns.shape[1] + 1) if x is None else x
    kept = [place for place in range(columns.shape[1]) if not np.isnan(columns[:, place]).all()]
    parts = [columns[:, place][~np.isnan(columns[:, place])] for place in kept]
    table = np.array([np.quantile(part, (0.25, 0.5, 0.75)) for part in parts]).reshape(-1, 3)
    return Quartiles(x[kept], table[:, 0], table[:, 1], table[:, 2])
