"""What a sweep's folder says beside its rows: the sweep itself, and the commands it was started with."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from novelty.sweep.folder import SweepFolder


@dataclass(frozen=True)
class SweepRecord:
    """How the rows came about; all of it may be missing.

    Attributes:
        title: One line; the name of the folder where the sweep has none.
        metrics: The scores that are to be shown first.
        settings: The file of the sweep; empty where it is not there.
        commands: The command lines that started it, without repetition.
    """

    title: str
    metrics: tuple[str, ...]
    settings: str
    commands: tuple[str, ...]

    @classmethod
    def read(cls, root: Path) -> SweepRecord:
        """Read what is there."""
        folder = SweepFolder(root)
        text = _text(folder.sweep_file)
        sweep = _mapping(text)
        started = [_command(file) for file in sorted(folder.starts.glob("*.json"))]
        return cls(
            str(sweep.get("title") or root.resolve().name),
            tuple(sweep.get("metrics") or ()),
            text,
            tuple(command for command in dict.fromkeys(started) if command),
        )


def _mapping(text: str) -> dict[str, Any]:
    """What a file of YAML says; nothing where it was damaged by hand: the rows are what counts."""
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError:
        return {}
    return content if isinstance(content, dict) else {}


def _command(file: Path) -> str:
    """The command line of one start; empty where the file was cut short."""
    try:
        return str(json.loads(_text(file)).get("command", ""))
    except ValueError:
        return ""


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8").strip() if file.is_file() else ""
