"""A configuration as a commented YAML file: the texts of `configs/default.yaml` and `configs/presets`."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import yaml

from novelty.config import Config
from novelty.section import section_fields

HEADER = """\
# Every setting of novelty with its default value. None is needed: `novelty detect` runs without a file.
# Keep the keys you change, in a file of your own, and pass it by --config, or set one by --set key=value.
"""


def commented_yaml(config: Config | None = None) -> str:
    """The configuration as YAML, each key under a comment that says what it does.

    Args:
        config: The settings to write; the defaults when None.
    """
    config = config or Config()
    return HEADER + "\n".join(_lines(Config, config.to_mapping(), indent="")) + "\n"


def changed_yaml(config: Config, header: str = "") -> str:
    """Only the settings that differ from the defaults, and the detector's name, each under its comment.

    Args:
        config: The settings to write.
        header: Comment lines that stand first.
    """
    changed = {"detector": config.detector} | _changes(config.to_mapping(), Config().to_mapping())
    return header + "\n".join(_lines(Config, changed, indent="")) + "\n"


def preset_yaml(name: str) -> str:
    """The settings of a preset that differ from the defaults, each under its comment."""
    header = f"# What the preset {name!r} changes: --preset {name}, or Config.preset({name!r}).\n"
    return changed_yaml(Config.preset(name), header)


def _changes(values: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The values that differ, nested as they were."""
    changed = {}
    for key, value in values.items():
        default = defaults[key]
        if value != default:
            changed[key] = _changes(value, default) if isinstance(value, dict) else value
    return changed


def _lines(cls: type[Any], values: Mapping[str, Any], indent: str) -> Iterator[str]:
    for key, info in section_fields(cls).items():
        if key not in values:
            continue
        value = values[key]
        if isinstance(value, dict):
            yield ""
            yield from _comment((info.annotation.__doc__ or "").partition("\n\n")[0], indent)
            yield f"{indent}{key}:"
            yield from _lines(info.annotation, value, indent + "  ")  # type: ignore[arg-type]
        else:
            yield from _comment(info.description or "", indent)
            yield f"{indent}{key}: {_scalar(value)}"


def _comment(text: str, indent: str) -> list[str]:
    flat = " ".join(text.split())
    return textwrap.wrap(flat, width=100, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")


def _scalar(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True, width=1000).removesuffix("\n").removesuffix("\n...")
