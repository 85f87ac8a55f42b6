"""The rows of a sweep as columns to calculate with, and the factors that the sweep varied, read from the rows."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.sweep.rows import FAILURES
from novelty.sweep.store import read_rows

NOT_FACTORS = ("seed",)
"""Keys whose values are repetitions of one experiment, not conditions of it."""

LABELS = {"max_components": "K_max", "data": "data"}
"""What readers call a factor, where its key is not the name to print."""


@dataclass(frozen=True, eq=False)
class Factor:
    """Something that differs between the runs of a sweep, and may explain why their results do.

    Attributes:
        key: A configuration key, an option of a simulation, `detector` or `data`.
        values: Its values, in order.
        codes: (R,) place of each run's value in `values`; -1 where the run has none.
    """

    key: str
    values: tuple[Any, ...]
    codes: NDArray[np.int64]

    @property
    def label(self) -> str:
        """What a heading calls it."""
        return LABELS.get(self.key, self.key)

    @property
    def numeric(self) -> bool:
        """Whether its values are numbers, which have a place on an axis."""
        return all(isinstance(value, int | float) and not isinstance(value, bool) for value in self.values)

    def text(self, place: int) -> str:
        """A value as readers see it."""
        value = self.values[place]
        return value if isinstance(value, str) else json.dumps(value)


@dataclass(frozen=True, eq=False)
class SweepRuns:
    """One row per run, R of them.

    Attributes:
        table: The rows, in the columns of `novelty.sweep.rows.SCHEMA`.
        root: The folder of the sweep.
    """

    table: pa.Table
    root: Path

    @classmethod
    def read(cls, root: str | Path) -> SweepRuns:
        """Read the rows of a sweep's folder.

        Raises:
            InputError: The folder holds no rows.
        """
        table = read_rows(root)
        if not len(table):
            raise InputError(f"{root}: the sweep has no finished run yet; nothing can be reported.")
        return cls(table, Path(root))

    def __len__(self) -> int:
        """R."""
        return len(self.table)

    def numbers(self, column: str) -> NDArray[np.float64]:
        """A column of numbers, (R,); NaN where not defined."""
        return self.table[column].cast(pa.float64()).fill_null(np.nan).to_numpy()

    def texts(self, column: str) -> NDArray[np.object_]:
        """A column of strings, (R,); empty where null."""
        return self.table[column].fill_null("").to_numpy()

    def distinct(self, column: str) -> list[str]:
        """The different strings of a column, without null."""
        return [value for value in pc.unique(self.table[column]).to_pylist() if value is not None]

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """Runs without an answer, (R,)."""
        return pc.is_in(self.table["status"], pa.array(FAILURES)).to_numpy()

    @cached_property
    def pair_codes(self) -> NDArray[np.int64]:
        """A number for the pair of each run, (R,)."""
        both = pc.binary_join_element_wise(
            self.table["data"].fill_null(""), self.table["pair"].fill_null(""), "\n"
        )
        return _codes(both)[0]

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """What varies: the axes of the sweep, the options of its simulations, the detector, K_max and the data."""
        found: dict[str, Factor] = {}
        for column in ("axes", "condition"):
            for factor in _factors_in(self.table[column]):
                found.setdefault(factor.key, factor)
        for column in ("detector", "max_components", "data"):
            found[column] = _factor(column, *_codes(self.table[column]))
        first = ("detector", "max_components")
        keys = [*first, *(key for key in found if key not in first)]
        varying = [found[key] for key in keys if len(found[key].values) > 1]
        return tuple(factor for factor in varying if factor.key != "data" or not _told_by(factor, varying))

    def factor(self, key: str) -> Factor | None:
        """The factor of that key; None where it does not vary."""
        return next((factor for factor in self.factors if factor.key == key), None)

    def constant(self, column: str) -> str:
        """The value of a column that is the same in all rows; the values one after the other where it is not."""
        return ", ".join(str(value) for value in pc.unique(self.table[column]).to_pylist())


def _told_by(factor: Factor, others: Sequence[Factor]) -> bool:
    """Whether one of the others tells its runs apart in the same way, under other names."""
    for other in others:
        both = len(np.unique(factor.codes * (len(other.values) + 1) + other.codes))
        if other is not factor and both == len(factor.values) == len(other.values):
            return True
    return False


def _codes(column: pa.ChunkedArray) -> tuple[NDArray[np.int64], list[Any]]:
    """The place of every value among the different ones, -1 for null, and those."""
    encoded = column.combine_chunks().dictionary_encode()
    codes = encoded.indices.fill_null(-1).to_numpy(zero_copy_only=False).astype(np.int64)
    return codes, encoded.dictionary.to_pylist()


def _factors_in(column: pa.ChunkedArray) -> Iterator[Factor]:
    """One factor per key of a column of JSON mappings; a mapping that lacks the key has no value."""
    codes, texts = _codes(column)
    mappings: list[Mapping[str, Any]] = [json.loads(text) if text else {} for text in texts]
    for key in dict.fromkeys(key for mapping in mappings for key in mapping):
        if key in NOT_FACTORS:
            continue
        values = [mapping.get(key) for mapping in mappings]
        present = [value for value in values if value is not None]
        different = list({_hashable(value): value for value in present}.values())
        places = {_hashable(value): place for place, value in enumerate(different)}
        of_text = np.array([-1 if value is None else places[_hashable(value)] for value in values] + [-1])
        yield _factor(key, of_text[codes], different)


def _factor(key: str, codes: NDArray[np.int64], values: Sequence[Any]) -> Factor:
    """With its values in order: numbers by size, anything else by name."""
    try:
        order = sorted(range(len(values)), key=lambda place: values[place])
    except TypeError:
        order = sorted(range(len(values)), key=lambda place: json.dumps(values[place]))
    rank = np.empty(len(values) + 1, dtype=np.int64)
    rank[order] = np.arange(len(values))
    rank[-1] = -1
    return Factor(key, tuple(values[place] for place in order), rank[codes])


def _hashable(value: Any) -> Hashable:
    return json.dumps(value, sort_keys=True)
