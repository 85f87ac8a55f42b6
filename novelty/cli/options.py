"""The options that several commands share, and the configuration they add up to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from novelty.config import Config
    from novelty.maps import SceneMap

DETECTORS = "likelihood, joint_mixture, unbalanced_emd, structural_matching or greedy_emd"

ConfigFile = Annotated[
    Path | None,
    typer.Option(
        "--config", metavar="FILE", help="Settings in YAML; see configs/default.yaml for every key."
    ),
]
Preset = Annotated[
    str | None,
    typer.Option(
        "--preset",
        metavar="NAME",
        help="Settings to begin with: paper, every choice as the paper's; paper_calibrated, its structural "
        "matching with thresholds found as in its section 3.2.",
    ),
]
Assignments = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="One setting, such as fit.n_init=3; repeatable."),
]
MaxComponents = Annotated[
    int | None, typer.Option(metavar="N", help="K_max, the order at which the MDL search starts.")
]
Seed = Annotated[int | None, typer.Option(metavar="N", help="Seed of every random choice.")]
Unit = Annotated[
    str | None, typer.Option(metavar="UNIT", help="Unit of the coordinates: m, cm, mm, in or ft.")
]


CurrentOrigin = Annotated[
    str | None, typer.Option(metavar='"X Y Z"', help="Where the sensor stood for the current scan.")
]


def build_config(
    file: Path | None, assignments: list[str] | None, preset: str | None = None, **given: Any
) -> Config:
    """The settings of a preset, changed by a file, by `--set`, and by the options that were given (not None).

    Raises:
        ConfigError: An unknown preset, an unknown key or a value that is not valid.
    """
    from novelty.config import Config

    return _changed(_read(Config() if preset is None else Config.preset(preset), file), assignments, given)


def build_map_config(
    scene_map: SceneMap,
    file: Path | None,
    assignments: list[str] | None,
    preset: str | None = None,
    **given: Any,
) -> Config:
    """What `build_config` does, beginning with the settings of a map where there is neither preset nor file."""
    if preset is None and file is None:
        return _changed(scene_map.config, assignments, given)
    return build_config(file, assignments, preset, **given)


def _read(config: Config, file: Path | None) -> Config:
    """The settings with those of a file in their place."""
    from novelty.config import read_yaml_mapping

    return config if file is None else config.updated(read_yaml_mapping(file))


def _changed(config: Config, assignments: list[str] | None, given: dict[str, Any]) -> Config:
    changes = dict(_split(assignment) for assignment in assignments or [])
    changes |= {key: value for key, value in given.items() if value is not None}
    return config.replace(**changes) if changes else config


def parse_origin(text: str | None, option: str) -> tuple[float, float, float] | None:
    """Three numbers; None stays None.

    Raises:
        typer.BadParameter: The text is not three numbers.
    """
    if text is None:
        return None
    try:
        x, y, z = (float(number) for number in text.replace(",", " ").split())
    except ValueError:
        raise typer.BadParameter(
            f'expected three numbers as "x y z", got {text!r}', param_hint=option
        ) from None
    return x, y, z


def _split(assignment: str) -> tuple[str, Any]:
    import yaml

    key, equals, value = assignment.partition("=")
    if not equals or not key.strip():
        raise typer.BadParameter(f"expected KEY=VALUE, got {assignment!r}", param_hint="--set")
    try:
        return key.strip(), yaml.safe_load(value)
    except yaml.YAMLError:
        raise typer.BadParameter(f"{value!r} is not a YAML value", param_hint="--set") from None
