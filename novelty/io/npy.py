"""NPY and NPZ (numpy)."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.scan import Scan


def read_npy(path: Path) -> Scan:
    """Read an array (N, 3) or wider, of which the first three columns are x, y and z.

    Raises:
        InputError: The file is damaged or holds something else.
    """
    with path.open("rb") as file:
        return Scan(_coordinates(_load(file, path), "the array", path), name=str(path))


def read_npz(path: Path) -> Scan:
    """Read the arrays `points` (N, 3) and, where they are there, `origin` (3,) or (N, 3) and `labels` (N,).

    Raises:
        InputError: The file is damaged, lacks `points`, or an array is not as documented for `Scan`.
    """
    if not zipfile.is_zipfile(path):
        raise InputError(f"{path}: expected an NPZ archive; the file is damaged or cut short. Copy it again.")
    arrays = _load(path, path)
    if "points" not in arrays:
        raise InputError(f"{path}: expected an array named 'points'; found {', '.join(arrays) or 'none'}.")
    points = _coordinates(arrays["points"], "'points'", path)
    return Scan(points, arrays.get("origin"), arrays.get("labels"), name=str(path))


def _load(file: Path | BinaryIO, path: Path) -> Any:
    try:
        loaded = np.load(file, allow_pickle=False)
        return loaded if isinstance(loaded, np.ndarray) else dict(loaded)
    # damage surfaces as what the parsers beneath raise: ValueError, EOFError, TokenError, BadZipFile ...
    except Exception as error:
        raise InputError(f"{path}: numpy cannot read the file, it is damaged ({error}).") from error


def _coordinates(array: NDArray[np.generic], what: str, path: Path) -> NDArray[np.generic]:
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiu":
        raise InputError(
            f"{path}: {what} must hold numbers in shape (N, 3) or wider; got {array.dtype} {array.shape}."
        )
    return array[:, :3]
