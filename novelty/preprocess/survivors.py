"""The points of one scan that are still examined while preprocessing takes others out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from novelty.scan import Scan


@dataclass(frozen=True, eq=False)
class Survivors:
    """What is left of one scan; every length is in metres.

    Attributes:
        points: float64 (N, 3).
        kept: int64 (N,), place of each of them in the scan as given.
        origin: Where the sensor stood, (3,) or (number of points given, 3); None when unknown.
        dropped: How many points each step took out.
        notes: What a reader of the result must know.
    """

    points: NDArray[np.float64]
    kept: NDArray[np.int64]
    origin: NDArray[np.float64] | None
    dropped: dict[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @classmethod
    def from_scan(cls, scan: Scan, metres: float) -> Survivors:
        """All points of `scan`, whose unit is `metres` long."""
        return cls(
            points=scan.points * metres,
            kept=np.arange(scan.num_points),
            origin=None if scan.origin is None else scan.origin * metres,
        )

    def __len__(self) -> int:
        """N."""
        return len(self.points)

    @property
    def point_origins(self) -> NDArray[np.float64] | None:
        """Where the sensor stood for each survivor, (N, 3) or (3,); None when unknown."""
        if self.origin is None or self.origin.ndim == 1:
            return self.origin
        return self.origin[self.kept]

    def only(self, stays: NDArray[np.bool_], step: str) -> Survivors:
        """The survivors where `stays` (N,) holds; the others are counted under `step`."""
        taken = len(self) - int(np.count_nonzero(stays))
        counts = {**self.dropped, step: self.dropped.get(step, 0) + taken}
        if taken == 0:
            return replace(self, dropped=counts)
        return replace(self, points=self.points[stays], kept=self.kept[stays], dropped=counts)

    def noted(self, note: str) -> Survivors:
        """The same points with one more note."""
        return replace(self, notes=(*self.notes, note))
