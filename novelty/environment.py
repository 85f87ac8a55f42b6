"""On what a result was made: the machine and the version of everything that took part."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from typing import Any

from novelty import __version__

MODULES = {
    "torch": "torch",
    "numpy": "numpy",
    "scipy": "scipy",
    "pot": "ot",
    "numba": "numba",
    "scikit-learn": "sklearn",
    "open3d": "open3d",
    "pydantic": "pydantic",
    "pyyaml": "yaml",
    "typer": "typer",
    "rich": "rich",
    "pyarrow": "pyarrow",
    "plotly": "plotly",
    "jinja2": "jinja2",
    "safetensors": "safetensors",
    "laspy": "laspy",
    "lazrs": "lazrs",
    "psutil": "psutil",
}
"""Every distribution that novelty needs, and the name under which it is imported."""


def installed_version(distribution: str) -> str | None:
    """The version of a distribution, None when it is not installed; imports nothing."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def versions() -> dict[str, str | None]:
    """The version of novelty, of Python and of every distribution it needs."""
    needed = {distribution: installed_version(distribution) for distribution in MODULES}
    return {"novelty": __version__, "python": platform.python_version(), **needed}


def machine() -> dict[str, Any]:
    """The computer, as far as it bears on speed."""
    return {"system": platform.platform(), "processor": platform.machine(), "cpu_count": os.cpu_count()}
