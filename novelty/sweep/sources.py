"""The pairs of a sweep: named at once, read or simulated when they are needed."""

from __future__ import annotations

import glob
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from novelty.errors import ConfigError, InputError
from novelty.io import FailedPair, PairEntry, read_entries
from novelty.scan import ScanPair
from novelty.simulation.experiments import Case, ExperimentPair, Setup, load_experiment
from novelty.sweep.settings import canonical_json
from novelty.sweep.sweep import Data, Sweep

DEFAULT_SEED, DEFAULT_COUNT = 0, 1


@dataclass(frozen=True)
class SweepPair:
    """One pair of a sweep, not read yet.

    Attributes:
        data: Name of the entry of `data` it comes from.
        name: Of the pair.
        source: Its files, its simulation, or why it cannot be had.
        unit: Unit of its coordinates; None: what the configuration says.
        condition: JSON of the options of the simulation that vary; {} for files.
    """

    data: str
    name: str
    source: PairEntry | ExperimentPair | FailedPair
    unit: str | None = None
    condition: str = "{}"

    def load(self) -> ScanPair:
        """Read or simulate both scans.

        Raises:
            InputError: A scan cannot be read, or the scene has no room for the change.
        """
        if isinstance(self.source, FailedPair):
            raise self.source.error
        if isinstance(self.source, ExperimentPair):
            return self.source.simulate().scans
        return self.source.load()


def pairs_of(sweep: Sweep) -> tuple[SweepPair, ...]:
    """All pairs of a sweep, entry by entry.

    Raises:
        InputError: A manifest is missing or damaged as a whole, or a pattern matches nothing.
        ConfigError: An experiment or a setup is not valid.
    """
    return tuple(pair for name, data in sweep.data.items() for pair in _pairs_of(name, data))


def _pairs_of(name: str, data: Data) -> Iterator[SweepPair]:
    if data.setup is not None or data.experiment is not None:
        for simulated in _simulated(name, data):
            condition = {"case": simulated.case.name, **simulated.case.varied, "seed": simulated.seed}
            yield SweepPair(name, simulated.name, simulated, "m", canonical_json(condition))
        return
    entries = read_entries(data.pairs) if data.pairs is not None else _matched(name, data)
    for entry in itertools.islice(entries, data.count):
        unit = data.unit if isinstance(entry, FailedPair) else entry.unit or data.unit
        yield SweepPair(name, entry.name, entry, unit)


def _simulated(name: str, data: Data) -> tuple[ExperimentPair, ...]:
    """The pairs of an experiment, or of a setup and what varies in it."""
    if data.experiment is not None:
        experiment = load_experiment(data.experiment)
        seed = experiment.seed if data.seed is None else data.seed
        return replace(experiment, repetitions=data.count or experiment.repetitions, seed=seed).pairs()
    seed, count = data.seed or DEFAULT_SEED, data.count or DEFAULT_COUNT
    return tuple(
        ExperimentPair(_pair_name(case, seed + repetition), case, repetition, seed + repetition)
        for case in _cases(name, data)
        for repetition in range(count)
    )


def _cases(name: str, data: Data) -> Iterator[Case]:
    for values in itertools.product(*data.vary.values()):
        varied = dict(zip(data.vary, values, strict=True))
        yield Case(name, varied, _setup(name, {**(data.setup or {}), **varied}))


def _setup(name: str, keys: dict[str, Any]) -> Setup:
    try:
        return TypeAdapter(Setup).validate_python(keys)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"data.{name}: key {key!r} of `setup`: {first['msg']} (got {first['input']!r})."
        ) from None


def _pair_name(case: Case, seed: int) -> str:
    text = "-".join([case.name, *(f"{key}={value}" for key, value in case.varied.items()), str(seed)])
    return re.sub(r"[^\w.=+-]+", "_", text).strip("_")


def _matched(name: str, data: Data) -> list[PairEntry]:
    """Pairs of files whose patterns are filled with the same text, by that text."""
    reference, current = _filled(data.reference or ""), _filled(data.current or "")
    both = [text for text in reference if text in current]
    if not both:
        raise InputError(
            f"data.{name}: no two files match {data.reference} ({len(reference)} files) and {data.current} "
            f"({len(current)} files) with the same text for `*`."
        )
    return [
        PairEntry("-".join(text).replace("/", "-"), reference[text], current[text], source=f"data.{name}")
        for text in both
    ]


def _filled(pattern: str) -> dict[tuple[str, ...], Path]:
    """The files that match a pattern, by what stands for its `*`."""
    if "*" not in pattern:
        raise ConfigError(f"the pattern {pattern!r} holds no `*`; name single pairs in a pairs.csv.")
    parts = re.compile("([^/]*)".join(map(re.escape, pattern.split("*"))))
    found = {file: parts.fullmatch(file) for file in sorted(glob.glob(pattern))}
    return {match.groups(): Path(file) for file, match in found.items() if match}
