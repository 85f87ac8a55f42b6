"""The one place of this package that loads Open3D: late, and with advice when the machine lacks a library."""

from __future__ import annotations

from types import ModuleType

from novelty.errors import MissingDependencyError


def load_open3d() -> ModuleType:
    """Import Open3D, which takes about a second the first time.

    Raises:
        MissingDependencyError: Open3D is not installed, or a system library that it needs is missing.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise MissingDependencyError(
            f"Open3D cannot be loaded: {error}. "
            "Run 'novelty doctor': it prints the command that installs what is missing."
        ) from error
    return open3d
