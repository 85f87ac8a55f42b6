"""Experiments from YAML files: those of `configs/experiments` by name, own ones by path.

A file holds `title`, `source`, `repetitions`, `seed`, `detectors`, `analyses` (settings of the comparison by name, a
list of values makes one analysis of each), `setup` (keys that all cases share, see `Setup`), `cases` (keys by name of
the case) and `vary` (keys of `Setup` with a list of values each: every case is made with every combination).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml
from pydantic import Field

from novelty.errors import ConfigError
from novelty.section import section
from novelty.simulation.experiments.experiment import Analysis, Case, Experiment
from novelty.simulation.experiments.setup import Setup, validated

Keys = dict[str, Any]


@section
class _File:
    """An experiment as it is written down."""

    title: str
    source: str
    repetitions: int = Field(ge=1)
    seed: int = Field(ge=0)
    cases: dict[str, Keys | None]
    setup: Keys = Field(default_factory=dict)
    vary: dict[str, list[Any]] = Field(default_factory=dict)
    detectors: tuple[str, ...] = Field(default=())
    analyses: dict[str, Keys | None] = Field(default_factory=dict)


def experiment_names() -> list[str]:
    """Names of the experiments that come with the package."""
    return sorted(path.stem for path in _folder().glob("*.yaml"))


def load_experiment(name: str | Path) -> Experiment:
    """An experiment by its name in `experiment_names()`, or from a YAML file.

    `dataclasses.replace(experiment, repetitions=2)` makes a shorter one of it.

    Raises:
        ConfigError: There is no such experiment, or its file is damaged; the message says where.
    """
    path = Path(name)
    if path.suffix not in {".yaml", ".yml"}:
        if str(name) not in experiment_names():
            raise ConfigError(
                f"There is no experiment {str(name)!r}; choose one of {', '.join(experiment_names())}, "
                "or name a .yaml file."
            )
        path = _folder() / f"{name}.yaml"
    content = validated(_File, _read(path), str(path))
    return Experiment(
        name=path.stem,
        title=content.title,
        source=content.source,
        repetitions=content.repetitions,
        seed=content.seed,
        cases=tuple(_cases(content, path)),
        detectors=content.detectors,
        analyses=tuple(_analyses(content)),
    )


def _folder() -> Path:
    """Where the experiments are: inside an installed package, beside it in a source tree."""
    package = Path(str(files("novelty")))
    installed, source = (root / "configs" / "experiments" for root in (package, package.parent))
    return installed if installed.is_dir() else source


def _cases(content: _File, path: Path) -> Iterator[Case]:
    for name, keys in content.cases.items():
        for varied in _combinations(content.vary):
            setup = {**content.setup, **(keys or {}), **varied}
            yield Case(name, varied, validated(Setup, setup, f"{path}, case {name!r}"))


def _analyses(content: _File) -> Iterator[Analysis]:
    for name, keys in content.analyses.items():
        lists = {key: value for key, value in (keys or {}).items() if isinstance(value, list)}
        for chosen in _combinations(lists):
            label = " ".join([name, *(str(value) for value in chosen.values())])
            yield Analysis(label, {**(keys or {}), **chosen})


def _combinations(lists: Mapping[str, list[Any]]) -> Iterator[Keys]:
    """Every choice of one value per key; the last key changes fastest."""
    for values in itertools.product(*lists.values()):
        yield dict(zip(lists, values, strict=True))


def _read(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: the experiment cannot be read: {error.strerror}.") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: expected YAML; {error}.") from None
