"""The libraries of the extra `[formats]`: loaded late, with the command that installs them where they are missing."""

from __future__ import annotations

import importlib
from types import ModuleType

from novelty.errors import MissingDependencyError


def load_format_library(module: str, kind: str) -> ModuleType:
    """Import a library that one kind of file needs.

    Args:
        module: The module, for example `pye57`.
        kind: What it reads, for the message: "E57 files".

    Raises:
        MissingDependencyError: It is not installed, or cannot be loaded.
    """
    try:
        return importlib.import_module(module)
    except (ImportError, OSError) as error:
        raise MissingDependencyError(
            f"{kind} need the library {module.partition('.')[0]}, which cannot be loaded: {error}. "
            "Run: pip install 'novelty-gmm[formats]'"
        ) from error
