"""A laser scan and a pair of scans of the same place: the problem, without any setting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.errors import InputError

UNCHANGED, CHANGED, SEEN_ONCE, AMBIGUOUS = 0, 1, 2, 255
"""Values of a scan's ground-truth labels: 2 is seen in one scan only (hidden in the other), 255 is not scored."""


@dataclass(frozen=True, eq=False)
class Scan:
    """The points of one scan, in the order in which the sensor delivered them.

    Attributes:
        points: float64 (N, 3), in the unit of `Config.unit`; NaN and inf mark missing returns.
        origin: Where the sensor stood: (3,), or (N, 3) for a moving sensor; None when unknown.
        labels: Ground truth, uint8 (N,): 0 unchanged, 1 changed, 2 seen in one scan only, 255 ambiguous.
            None when unknown.
        name: What messages call the scan.
    """

    points: NDArray[np.float64]
    origin: NDArray[np.float64] | None = None
    labels: NDArray[np.uint8] | None = None
    name: str = ""

    def __init__(
        self,
        points: ArrayLike,
        origin: ArrayLike | None = None,
        labels: ArrayLike | None = None,
        name: str = "",
    ) -> None:
        """Check the shapes and store read-only float64 arrays.

        Raises:
            InputError: A shape or a type is not the one documented above.
        """
        set_field = object.__setattr__
        set_field(self, "name", name)
        set_field(self, "points", _points(points, name))
        set_field(self, "origin", None if origin is None else _origin(origin, self.num_points, name))
        set_field(self, "labels", None if labels is None else _labels(labels, self.num_points, name))

    @property
    def num_points(self) -> int:
        """N, missing returns included."""
        return len(self.points)


@dataclass(frozen=True)
class ScanPair:
    """Two scans of one place in one coordinate frame: before (`reference`) and now (`current`)."""

    reference: Scan
    current: Scan
    name: str = ""


def _points(points: ArrayLike, name: str) -> NDArray[np.float64]:
    array = _float64(points, "points", name)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(
            f"{_label(name)}: points must have shape (N, 3), one row per point; got {array.shape}."
        )
    return array


def _origin(origin: ArrayLike, num_points: int, name: str) -> NDArray[np.float64]:
    array = _float64(origin, "origin", name)
    if array.shape not in {(3,), (num_points, 3)}:
        raise InputError(
            f"{_label(name)}: origin must have shape (3,), or ({num_points}, 3) for a moving sensor; "
            f"got {array.shape}. Pass None when the origin is unknown."
        )
    return array


def _labels(labels: ArrayLike, num_points: int, name: str) -> NDArray[np.uint8]:
    array = np.array(labels)
    if array.shape != (num_points,):
        raise InputError(
            f"{_label(name)}: labels must have shape ({num_points},), one per point; got {array.shape}."
        )
    if not np.isin(array, (UNCHANGED, CHANGED, SEEN_ONCE, AMBIGUOUS)).all():
        found = ", ".join(str(value) for value in np.unique(array)[:8])
        raise InputError(f"{_label(name)}: labels must be 0, 1, 2 or 255; found {found}.")
    return _read_only(array.astype(np.uint8))


def _float64(values: ArrayLike, field: str, name: str) -> NDArray[np.float64]:
    try:
        return _read_only(np.array(values, dtype=np.float64, order="C"))
    except (TypeError, ValueError) as error:
        raise InputError(f"{_label(name)}: {field} must be an array of numbers; {error}.") from None


def _read_only(array: NDArray) -> NDArray:
    array.flags.writeable = False
    return array


def _label(name: str) -> str:
    return f"scan {name!r}" if name else "scan"
