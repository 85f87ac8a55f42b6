"""The one way from the named columns of a file (x, y, z, label) to a `Scan`."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.errors import InputError
from novelty.scan import AMBIGUOUS, CHANGED, SEEN_ONCE, UNCHANGED, Scan

ORIGIN_COLUMNS = {"origin_x", "origin_y", "origin_z"}


def scan_from_columns(
    columns: Mapping[str, NDArray[np.generic]], path: Path, origin: ArrayLike | None = None
) -> Scan:
    """Make a scan of the columns `x`, `y`, `z` and, where there are any, `label` and `origin_x`, ..., each (N,).

    `origin_x`, `origin_y` and `origin_z` say where a moving sensor stood when it measured each point; `origin` is what
    the file says of all of them.

    Raises:
        InputError: A coordinate is missing.
    """
    if not {"x", "y", "z"} <= columns.keys():
        found = ", ".join(columns) or "nothing"
        raise InputError(f"{path}: expected the fields x, y and z; found {found}.")
    points = np.stack([columns[axis] for axis in "xyz"], axis=1)  # (N, 3)
    if columns.keys() >= ORIGIN_COLUMNS:
        origin = np.stack([columns[f"origin_{axis}"] for axis in "xyz"], axis=1)
    return Scan(points, origin, _ground_truth(columns.get("label"), path), name=str(path))


def cut_short(path: Path, announced: int, found: int) -> InputError:
    """The error for a file that ends before the points that its header announces."""
    return InputError(
        f"{path}: the file is cut short: its header announces {announced} points, {found} follow. "
        "Copy it again."
    )


def no_points(path: Path) -> InputError:
    """The error for a file that is in order and empty."""
    return InputError(f"{path}: the file contains no points.")


def _ground_truth(values: NDArray[np.generic] | None, path: Path) -> NDArray[np.generic] | None:
    """Take a field `label` as ground truth, unless its values show that it means something else."""
    if values is None or np.isin(values, (UNCHANGED, CHANGED, SEEN_ONCE, AMBIGUOUS)).all():
        return values
    found = ", ".join(str(value) for value in np.unique(values)[:6])
    warnings.warn(
        f"{path}: the field 'label' holds {found}; it is not used as ground truth, which is 0 unchanged, "
        "1 changed, 2 seen in one scan only, 255 not scored.",
        stacklevel=5,
    )
    return None
