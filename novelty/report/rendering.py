"""A page from a template and the assets beside it; it is self-contained and opens without a network."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any


def render(template: str, content: Mapping[str, Any], **variables: Any) -> str:
    """Fill a template of `assets`.

    Args:
        template: Its file name.
        content: What the scripts of the page read, as JSON in the variable `figures`.
        variables: What the template names.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from plotly.offline import get_plotlyjs

    with resources.as_file(resources.files("novelty.report") / "assets") as assets:
        environment = Environment(
            loader=FileSystemLoader(assets),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        environment.globals["asset"] = lambda name: _asset(assets, name)
        return environment.get_template(template).render(
            plotly=get_plotlyjs(), figures=as_script(content), **variables
        )


def as_script(content: Mapping[str, Any]) -> str:
    """JSON that can stand in a page: no text in it can end the script."""
    return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")


def _asset(folder: Path, name: str) -> str:
    return (folder / name).read_text(encoding="utf-8")
