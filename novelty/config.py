"""The configuration: one frozen object, valid when it exists, whose defaults need no tuning."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, TypeAdapter, ValidationError, field_validator

from novelty.baselines import M3C2, Baseline, FuzzyPartition, KMeansMixture, NearestNeighbour, VoxelDifference
from novelty.detectors import (
    Detector,
    GreedyEmd,
    JointMixture,
    Likelihood,
    StructuralMatching,
    UnbalancedEmd,
)
from novelty.errors import ConfigError
from novelty.fitting import Fit
from novelty.preprocess import Preprocess
from novelty.presets import PRESETS
from novelty.refinement import Refine
from novelty.registration import Registration
from novelty.section import section, section_fields
from novelty.segment import Segment
from novelty.visibility import Visibility


@section
class Config:
    """Every setting of `novelty.detect`; a detector joins by its section here, named as in `detector`."""

    detector: str = Field(default="likelihood", description="Which detector compares the mixtures.")
    max_components: int = Field(
        default=20, ge=1, description="K_max, the order at which the MDL search starts."
    )
    seed: int = Field(default=0, ge=0, description="Seed of every random choice.")
    unit: Literal["m", "cm", "mm", "in", "ft"] = Field(
        default="m", description="Unit of the scans' coordinates."
    )
    preprocess: Preprocess = Field(default_factory=Preprocess)
    fit: Fit = Field(default_factory=Fit)
    registration: Registration = Field(default_factory=Registration)
    segment: Segment = Field(default_factory=Segment)
    refine: Refine = Field(default_factory=Refine)
    visibility: Visibility = Field(default_factory=Visibility)
    greedy_emd: GreedyEmd = Field(default_factory=GreedyEmd)
    structural_matching: StructuralMatching = Field(default_factory=StructuralMatching)
    unbalanced_emd: UnbalancedEmd = Field(default_factory=UnbalancedEmd)
    joint_mixture: JointMixture = Field(default_factory=JointMixture)
    likelihood: Likelihood = Field(default_factory=Likelihood)
    nearest_neighbour: NearestNeighbour = Field(default_factory=NearestNeighbour)
    voxel_difference: VoxelDifference = Field(default_factory=VoxelDifference)
    m3c2: M3C2 = Field(default_factory=M3C2)
    kmeans_mixture: KMeansMixture = Field(default_factory=KMeansMixture)
    fuzzy_partition: FuzzyPartition = Field(default_factory=FuzzyPartition)

    @field_validator("detector")
    @classmethod
    def _known_detector(cls, name: str) -> str:
        known = [*detector_names(), *baseline_names()]
        if name not in known:
            raise ValueError(f"unknown detector {name!r}{_nearest(name, known)}")
        return name

    @property
    def chosen_detector(self) -> Detector:
        """The detector that `detector` names, with its parameters."""
        return getattr(self, self.detector)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> Config:
        """Build from nested mappings; absent keys keep their defaults.

        Raises:
            ConfigError: An unknown key or a value out of its domain; the message names both.
        """
        try:
            return _adapter().validate_python(dict(mapping))
        except ValidationError as error:
            raise ConfigError(_explain(error)) from None

    @classmethod
    def from_yaml(cls, path: str | Path) -> Config:
        """Read a YAML file of settings; see `configs/default.yaml` for every key.

        Raises:
            ConfigError: The file is missing, is not YAML, or holds an unknown key or an invalid value.
        """
        return cls.from_mapping(read_yaml_mapping(path))

    @classmethod
    def preset(cls, name: str) -> Config:
        """A named set of settings: `paper`, every choice as in the paper.

        Raises:
            ConfigError: There is no preset of that name.
        """
        if name not in PRESETS:
            raise ConfigError(f"unknown preset {name!r}{_nearest(name, list(PRESETS))}")
        return cls().replace(**PRESETS[name])

    def updated(self, mapping: Mapping[str, Any]) -> Config:
        """A copy with the keys of nested mappings changed; `Config().updated(m)` equals `Config.from_mapping(m)`.

        Raises:
            ConfigError: An unknown key or a value out of its domain; the message names both.
        """
        return type(self).from_mapping(_merged(self.to_mapping(), mapping))

    def replace(self, **overrides: Any) -> Config:
        """A copy with some keys changed; nested keys are dotted: `replace(**{"fit.n_init": 3})`.

        Raises:
            ConfigError: An unknown key or an invalid value.
        """
        mapping = self.to_mapping()
        for dotted, value in overrides.items():
            _set_dotted(mapping, dotted, value)
        return type(self).from_mapping(mapping)

    def to_mapping(self) -> dict[str, Any]:
        """Nested plain dictionaries, as a YAML file would hold them; `from_mapping` inverts it."""
        return _adapter().dump_python(self, mode="json")


def detector_names() -> list[str]:
    """Names under which `Config.detector` knows the detectors, in the order of their sections."""
    baselines = baseline_names()
    return [name for name in _names_of(Detector) if name not in baselines]


def baseline_names() -> list[str]:
    """Names under which `Config.detector` knows the methods that the detectors are measured against."""
    return _names_of(Baseline)


def _names_of(wanted: type[object]) -> list[str]:
    kinds = {name: info.annotation for name, info in section_fields(Config).items()}
    return [name for name, kind in kinds.items() if isinstance(kind, type) and issubclass(kind, wanted)]


def read_yaml_mapping(path: str | Path) -> dict[str, Any]:
    """The mapping that a YAML file holds.

    Raises:
        ConfigError: The file is missing, is not YAML, or is not a mapping.
    """
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read the configuration {path}: {error.strerror or error}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not valid YAML: {error}") from None
    if not isinstance(content, dict | None):
        raise ConfigError(f"{path} must hold `key: value` lines; found a {type(content).__name__}.")
    return content or {}


def _merged(mapping: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """`mapping` with the leaves of `changes` in the place of its own."""
    merged = dict(mapping)
    for key, value in changes.items():
        inner = merged.get(key)
        merged[key] = (
            _merged(inner, value) if isinstance(inner, dict) and isinstance(value, Mapping) else value
        )
    return merged


def _adapter() -> TypeAdapter[Config]:
    return TypeAdapter(Config)


def _set_dotted(mapping: dict[str, Any], dotted: str, value: Any) -> None:
    *parents, leaf = dotted.split(".")
    for parent in parents:
        inner = mapping.get(parent)
        if not isinstance(inner, dict):
            advice = _elsewhere(leaf) or _nearest(parent, list(mapping))
            raise ConfigError(f"unknown configuration key {dotted!r}{advice}")
        mapping = inner
    mapping[leaf] = value


def _explain(error: ValidationError) -> str:
    return "\n".join(
        _explain_one(item["loc"], item["type"], item["msg"], item["input"]) for item in error.errors()
    )


def _explain_one(location: tuple[Any, ...], kind: str, message: str, given: Any) -> str:
    key = ".".join(str(part) for part in location)
    if kind == "unexpected_keyword_argument":
        return f"unknown configuration key {key!r}{_nearest_key(location)}"
    message = message.removeprefix("Value error, ")
    told = isinstance(given, str) and repr(given) in message
    return f"configuration key {key!r}: {message}{'' if told else f' (got {given!r})'}"


def _nearest_key(location: tuple[Any, ...]) -> str:
    """The keys of that name in other sections, or else the key of the same section whose name is most like it."""
    *parents, name = location
    return _elsewhere(name) or _nearest(
        name, _siblings(tuple(parents)), "".join(f"{part}." for part in parents)
    )


def _elsewhere(name: str) -> str:
    """The keys whose last part is this; empty where there are none."""
    keys = [key for key in _dotted_keys() if key.split(".")[-1] == name]
    return f"; did you mean {' or '.join(map(repr, keys))}?" if keys else ""


def _dotted_keys() -> list[str]:
    """Every key of the configuration as `replace` takes it."""
    keys = []
    for name, info in section_fields(Config).items():
        inner = getattr(info.annotation, "__pydantic_fields__", None)
        keys += [name] if inner is None else [f"{name}.{key}" for key in inner]
    return keys


def _siblings(location: tuple[Any, ...]) -> list[str]:
    cls: Any = Config
    for part in location:
        cls = section_fields(cls)[part].annotation
    return list(section_fields(cls))


def _nearest(name: str, known: list[str], prefix: str = "") -> str:
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"; did you mean {prefix + close[0]!r}?" if close else f"; known: {', '.join(known)}"
