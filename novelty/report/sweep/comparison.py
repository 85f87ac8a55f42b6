"""Two sweeps side by side: the same pairs under the same conditions, and the difference of every two runs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.evaluation.intervals import Interval
from novelty.report.sweep.runs import Factor, SweepRuns
from novelty.report.sweep.summary import METRICS, group_rows, mean_interval, pair_means

COLUMNS = (*METRICS, "seconds")
"""What is compared."""


@dataclass(frozen=True, eq=False)
class Difference:
    """One quantity in the runs that both sweeps have.

    Attributes:
        first: Its mean in the first sweep.
        second: Its mean in the second.
        difference: Second less first, with its 95 % interval over the pairs.
        better: Share of the runs in which it is higher in the second sweep, ties as a half.
    """

    first: float
    second: float
    difference: Interval
    better: float


@dataclass(frozen=True, eq=False)
class Line:
    """The runs with one value of the series, or all of them.

    Attributes:
        name: The value.
        num_runs: Runs that both sweeps have.
        differences: By column.
    """

    name: str
    num_runs: int
    differences: dict[str, Difference]


@dataclass(frozen=True, eq=False)
class Comparison:
    """What changed from a first sweep to a second.

    Attributes:
        matched_by: What must be equal for two runs to be compared.
        differing: Factors that have one value in each sweep, and not the same: what the sweeps compare.
        lines: All runs first, then each value of the series.
        only_first: Runs without a counterpart in the second sweep.
        only_second: Runs without a counterpart in the first.
    """

    matched_by: tuple[str, ...]
    differing: tuple[str, ...]
    lines: tuple[Line, ...]
    only_first: int
    only_second: int


def compare(first: SweepRuns, second: SweepRuns, series: Factor | None) -> Comparison:
    """Match the runs of two sweeps by pair, repetition and the factors that vary in either.

    Args:
        first: The sweep that the report is about.
        second: The other one.
        series: Factor of the first sweep that gives the lines of the table.

    Raises:
        InputError: No run of one sweep has a counterpart in the other.
    """
    keys = dict.fromkeys(
        factor.key for runs in (first, second) for factor in runs.factors if factor.key != "data"
    )
    rows = _match(first, second, tuple(keys))
    if not len(rows[0]):
        raise InputError(
            f"{first.root} and {second.root} have no run in common. Runs are matched by pair, repetition"
            f"{''.join(f', {key}' for key in keys)}; compare sweeps over the same pairs."
        )
    return Comparison(
        ("pair", "repetition", *keys),
        tuple(_differing(first, second)),
        tuple(_lines(first, second, rows, series)),
        len(first) - len(rows[0]),
        len(second) - len(rows[1]),
    )


def _match(
    first: SweepRuns, second: SweepRuns, keys: Sequence[str]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of both sweeps that belong together; a run that stands for several is matched once."""
    places = {name: row for row, name in enumerate(_names(second, keys))}
    matched = {name: row for row, name in enumerate(_names(first, keys)) if name in places}
    rows = np.array([(row, places[name]) for name, row in matched.items()], dtype=np.int64).reshape(-1, 2)
    return rows[:, 0], rows[:, 1]


def _names(runs: SweepRuns, keys: Sequence[str]) -> list[tuple[str, ...]]:
    columns = [runs.texts("pair"), [str(number) for number in runs.table["repetition"].to_pylist()]]
    columns += [_values(runs, key) for key in keys]
    return list(zip(*columns, strict=True))


def _values(runs: SweepRuns, key: str) -> list[str]:
    """The value of a factor in every run, as text; of a sweep in which it does not vary, what its rows say."""
    factor = runs.factor(key)
    if factor is not None:
        texts = [*(factor.text(place) for place in range(len(factor.values))), ""]
        return [texts[code] for code in factor.codes]
    return [_constant(runs, key)] * len(runs)


def _constant(runs: SweepRuns, key: str) -> str:
    """The value of a key that is the same in all rows; empty where they do not have it."""
    if key in runs.table.column_names:
        return runs.constant(key)
    settings: dict[str, object] = {}
    for column in ("configuration", "condition", "axes"):
        settings |= _flat(json.loads(runs.table[column][0].as_py() or "{}"))
    value = settings.get(key, "")
    return value if isinstance(value, str) else json.dumps(value)


def _differing(first: SweepRuns, second: SweepRuns) -> list[str]:
    """Settings that are the same in all runs of a sweep, and different in the other."""
    settings = [_shared_settings(runs) for runs in (first, second)]
    return [
        f"{key}: {settings[0][key]} → {settings[1][key]}"
        for key in settings[0]
        if key in settings[1] and settings[0][key] != settings[1][key]
    ]


def _shared_settings(runs: SweepRuns) -> dict[str, str]:
    flat = [_flat(json.loads(text)) for text in runs.distinct("configuration")]
    shared = {
        key: value for key, value in flat[0].items() if all(other.get(key) == value for other in flat[1:])
    }
    return {"code": runs.constant("code")} | {key: json.dumps(value) for key, value in shared.items()}


def _flat(mapping: dict[str, object], prefix: str = "") -> dict[str, object]:
    flat: dict[str, object] = {}
    for key, value in mapping.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return flat


def _lines(
    first: SweepRuns,
    second: SweepRuns,
    rows: tuple[NDArray[np.int64], NDArray[np.int64]],
    series: Factor | None,
) -> list[Line]:
    values = {column: (first.numbers(column)[rows[0]], second.numbers(column)[rows[1]]) for column in COLUMNS}
    pairs = first.pair_codes[rows[0]]
    everything = np.arange(len(rows[0]))
    groups = [("all", everything)]
    if series is not None:
        among = Factor(series.key, series.values, series.codes[rows[0]])
        groups += [
            (series.text(places[0]), members) for places, members in group_rows([among], len(everything))
        ]
    return [
        Line(
            name,
            len(members),
            {
                column: _difference(a[members], b[members], pairs[members])
                for column, (a, b) in values.items()
            },
        )
        for name, members in groups
    ]


def _difference(
    first: NDArray[np.float64], second: NDArray[np.float64], pairs: NDArray[np.int64]
) -> Difference:
    change = second - first
    defined = ~np.isnan(change)
    if not defined.any():
        return Difference(np.nan, np.nan, mean_interval(np.empty(0)), np.nan)
    better = (change[defined] > 0) + 0.5 * (change[defined] == 0)
    return Difference(
        float(first[defined].mean()),
        float(second[defined].mean()),
        mean_interval(pair_means(change, pairs)),
        float(better.mean()),
    )
