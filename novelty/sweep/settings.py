"""Settings: the configurations that a sweep runs, one per combination of its axes and repetition."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from novelty.config import Config
from novelty.sweep.sweep import Sweep


@dataclass(frozen=True, eq=False)
class Setting:
    """One configuration in one repetition.

    Attributes:
        index: Its place among the settings of the sweep.
        base: The configuration, its seed as in the sweep.
        axes: The keys that vary and their values here.
        repetition: 0, 1, ...
    """

    index: int
    base: Config
    axes: dict[str, Any]
    repetition: int

    @cached_property
    def config(self) -> Config:
        """The configuration as it is run: its seed is that of the sweep plus the repetition."""
        return self.base.replace(seed=self.base.seed + self.repetition)

    @cached_property
    def configuration(self) -> str:
        """The configuration as JSON, its seed as in the sweep."""
        return canonical_json(self.base.to_mapping())

    @cached_property
    def digest(self) -> str:
        """Hash of the configuration as it is run, and of the repetition."""
        return hashlib.sha256(f"{self.configuration}\n{self.repetition}".encode()).hexdigest()


def settings_of(sweep: Sweep) -> tuple[Setting, ...]:
    """All settings of a sweep, repetition by repetition innermost.

    Raises:
        ConfigError: A key of the configuration is not known or a value is not valid.
    """
    shared = Config().replace(**sweep.configuration)
    chosen = itertools.product(_combinations(sweep), range(sweep.repetitions))
    configs = {canonical_json(axes): shared.replace(**axes) for axes in _combinations(sweep)}
    return tuple(
        Setting(index, configs[canonical_json(axes)], axes, repetition)
        for index, (axes, repetition) in enumerate(chosen)
    )


def _combinations(sweep: Sweep) -> Iterator[dict[str, Any]]:
    """Every choice of one value per axis; the last key of `grid` changes fastest."""
    tied = [
        dict(zip(sweep.zip, values, strict=True)) for values in zip(*sweep.zip.values(), strict=True)
    ] or [{}]
    for together, values in itertools.product(tied, itertools.product(*sweep.grid.values())):
        yield together | dict(zip(sweep.grid, values, strict=True))


def canonical_json(value: Any) -> str:
    """JSON that is the same for equal values."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
