"""A sweep as it is written down: data, the configuration keys that vary, repetitions."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, TypeAdapter, ValidationError, field_validator, model_validator

from novelty.config import read_yaml_mapping
from novelty.errors import ConfigError
from novelty.section import section, section_fields
from novelty.sweep.rows import METRICS

KINDS = ("pairs", "reference", "experiment", "setup")
"""The key that says what kind of data an entry names; `reference` goes with `current`."""

PATHS = ("pairs", "reference", "current")
"""Keys of an entry of `data` that hold paths, relative to the file of the sweep."""

OPEN = ("configuration", "grid", "zip")
"""Keys of a sweep whose own keys are dotted keys of the configuration."""


@section
class Data:
    """One entry of `data`: files, or pairs that are simulated when they are needed. Give one kind.

    An environment variable in a path is filled in: `$NOVELTY_DATA/pairs.csv`.
    """

    pairs: str | None = Field(
        default=None,
        description="A pairs.csv, or a folder of scans with poses (consecutive scans are the pairs).",
    )
    reference: str | None = Field(
        default=None, description="Pattern of the reference scans, one `*` or more: `scans/*/before.ply`."
    )
    current: str | None = Field(
        default=None,
        description="Pattern of the current scans, with as many `*`, which stand for the same text.",
    )
    unit: Literal["m", "cm", "mm", "in", "ft"] | None = Field(
        default=None, description="Unit of the coordinates of these files; null: what `configuration` says."
    )
    experiment: str | None = Field(
        default=None, description="A simulated experiment: a name in configs/experiments, or a .yaml file."
    )
    setup: dict[str, Any] | None = Field(
        default=None,
        description="A simulated pair: keys of `novelty.simulation.Setup` (scene, changes, ...).",
    )
    vary: dict[str, list[Any]] = Field(
        default_factory=dict,
        description="Keys of `setup` with a list of values each; every combination is made.",
    )
    seed: int | None = Field(
        default=None, ge=0, description="First seed of simulated pairs; the next take the next."
    )
    count: int | None = Field(
        default=None, ge=1, description="Simulated: seeds per condition. Files: take the first pairs only."
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Data:
        kinds = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(kinds) != 1 or (self.reference is None) != (self.current is None):
            raise ValueError(
                "give one of `pairs`, `reference` with `current`, `experiment`, and `setup`; "
                f"found {', '.join(kinds) or 'none'}"
            )
        return self


@section
class Sweep:
    """Every pair of `data` under every configuration of `grid` and `zip`, `repetitions` times."""

    title: str = Field(default="", description="One line for the report.")
    data: dict[str, Data] = Field(description="Where the pairs come from, by names of your choice.")
    configuration: dict[str, Any] = Field(
        default_factory=dict, description="Configuration keys of all runs that differ from the defaults."
    )
    grid: dict[str, list[Any]] = Field(
        default_factory=dict,
        description="Configuration keys with a list of values each: every combination is run.",
    )
    zip: dict[str, list[Any]] = Field(
        default_factory=dict,
        description="Configuration keys with lists of one length: the first values together, the second together, "
        "and so on, each with every combination of `grid`.",
    )
    repetitions: int = Field(
        default=1, ge=1, description="Runs of everything; repetition r has the seed `seed` + r."
    )
    metrics: tuple[str, ...] = Field(
        default=("kappa", "cramers_v", "uncertainty"),
        description="What summaries show first, best known first; every metric is kept in the rows.",
    )
    keep: tuple[Literal["labels", "mixtures"], ...] = Field(
        default=(), description="What is kept of every run beside its row: labels of all points, mixtures."
    )

    @field_validator("data")
    @classmethod
    def _some_data(cls, data: dict[str, Data]) -> dict[str, Data]:
        if not data:
            raise ValueError(
                "name at least one entry, such as `rooms: {setup: {scene: room, changes: [person]}}`"
            )
        return data

    @field_validator("grid", "zip")
    @classmethod
    def _some_values(cls, axes: dict[str, list[Any]]) -> dict[str, list[Any]]:
        for key, values in axes.items():
            if not values:
                raise ValueError(f"{key} has no values")
        return axes

    @field_validator("zip")
    @classmethod
    def _one_length(cls, axes: dict[str, list[Any]]) -> dict[str, list[Any]]:
        if len({len(values) for values in axes.values()}) > 1:
            lengths = ", ".join(f"{key} {len(values)}" for key, values in axes.items())
            raise ValueError(f"the lists must have one length; found {lengths}")
        return axes

    @field_validator("metrics")
    @classmethod
    def _known_metrics(cls, metrics: tuple[str, ...]) -> tuple[str, ...]:
        for metric in metrics:
            if metric not in METRICS:
                raise ValueError(f"unknown metric {metric!r}{_nearest(metric, METRICS)}")
        return metrics

    @property
    def axes(self) -> tuple[str, ...]:
        """The configuration keys that vary."""
        return (*self.zip, *self.grid)

    def to_mapping(self) -> dict[str, Any]:
        """Nested plain dictionaries with every default written out; `Sweep.from_mapping` inverts it."""
        return TypeAdapter(Sweep).dump_python(self, mode="json")

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> Sweep:
        """Build from nested mappings.

        Raises:
            ConfigError: An unknown key, with the nearest valid one, or an invalid value.
        """
        _check_keys(mapping, cls, "")
        for name, entry in (mapping.get("data") or {}).items():
            if isinstance(entry, Mapping):
                _check_keys(entry, Data, f"data.{name}.")
        try:
            return TypeAdapter(Sweep).validate_python(dict(mapping))
        except ValidationError as error:
            raise ConfigError("\n".join(_explained(item) for item in error.errors())) from None


def sweep_names() -> list[str]:
    """Names of the sweeps that come with the package."""
    return sorted(path.stem for path in _folder().glob("*.yaml"))


def load_sweep(file: str | Path, assignments: Sequence[str] = ()) -> Sweep:
    """Read a sweep, changed by assignments such as `grid.max_components=[8,20]`.

    Paths in the file are relative to it, those in assignments to the working directory.

    Args:
        file: A YAML file, or a name in `sweep_names()`.
        assignments: `key=value` each.

    Raises:
        ConfigError: The file is missing or is not YAML, or a key or a value is not valid.
    """
    path = _folder() / f"{file}.yaml" if str(file) in sweep_names() else Path(file)
    if path.suffix not in (".yaml", ".yml") and not path.exists():
        known = ", ".join(sweep_names())
        raise ConfigError(f"There is no sweep {str(file)!r}; choose one of {known}, or name a YAML file.")
    mapping = _with_paths(read_yaml_mapping(path), path.resolve().parent)
    changes: dict[str, Any] = {}
    for assignment in assignments:
        _assign(changes, assignment)
    return Sweep.from_mapping(_merged(mapping, _with_paths(changes, Path.cwd())))


def _folder() -> Path:
    """Where the sweeps are: inside an installed package, beside it in a source tree."""
    package = Path(str(files("novelty")))
    installed, source = (root / "configs" / "sweeps" for root in (package, package.parent))
    return installed if installed.is_dir() else source


def _assign(mapping: dict[str, Any], assignment: str) -> None:
    """Set one `key=value`; in `grid`, `zip` and `configuration` the rest of the key is a key of the configuration."""
    key, sign, text = assignment.partition("=")
    if not sign:
        raise ConfigError(f"expected key=value, got {assignment!r}.")
    first, _, rest = key.partition(".")
    *parents, leaf = [first, rest] if first in OPEN and rest else key.split(".")
    for parent in parents:
        mapping = mapping.setdefault(parent, {})
    try:
        mapping[leaf] = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"{key}: {text!r} is not a YAML value: {error}") from None


def _merged(mapping: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    both = {
        key: _merged(mapping[key], value)
        if isinstance(value, Mapping) and isinstance(mapping.get(key), Mapping)
        else value
        for key, value in changes.items()
    }
    return {**mapping, **both}


def _with_paths(mapping: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The same with the paths of `data` absolute and environment variables filled in."""
    data = mapping.get("data")
    if not isinstance(data, Mapping):
        return mapping
    return {**mapping, "data": {name: _entry_with_paths(name, entry, folder) for name, entry in data.items()}}


def _entry_with_paths(name: str, entry: Any, folder: Path) -> Any:
    if not isinstance(entry, Mapping):
        return entry
    paths = {key: _absolute(f"data.{name}.{key}", entry[key], folder) for key in PATHS if entry.get(key)}
    experiment = entry.get("experiment")
    if isinstance(experiment, str) and experiment.endswith((".yaml", ".yml")):
        paths["experiment"] = _absolute(f"data.{name}.experiment", experiment, folder)
    return {**entry, **paths}


def _absolute(key: str, path: Any, folder: Path) -> str:
    filled = os.path.expanduser(os.path.expandvars(str(path)))
    if "$" in filled:
        raise ConfigError(f"{key}: the environment variable in {path!r} is not set.")
    return str(folder / filled)


def _check_keys(mapping: Mapping[str, Any], kind: type[Any], where: str) -> None:
    known = section_fields(kind)
    for key in mapping:
        if key not in known:
            raise ConfigError(f"unknown key {where + str(key)!r} in the sweep{_nearest(str(key), known)}")


def _explained(item: Any) -> str:
    key = ".".join(str(part) for part in item["loc"])
    return (
        f"key {key!r} in the sweep: {item['msg'].removeprefix('Value error, ')} (got {item['input']!r:.200})"
    )


def _nearest(name: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else f"; known: {', '.join(known)}"
