"""Novelty by nearest neighbour: a point far from every point of the other scan (cloud-to-cloud distance)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial import cKDTree

from novelty.baselines.base import PointBaseline
from novelty.section import section


@section
class NearestNeighbour(PointBaseline):
    """Points farther than a distance from every point of the other scan are novel (baseline, C2C)."""

    distance: float = Field(
        default=0.04, gt=0, description="Distance from the nearest point of the other scan, m."
    )

    @property
    def threshold(self) -> float:
        """`distance`, m."""
        return self.distance

    def scores(self, points: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance from the nearest point of the other scan, m (N,)."""
        return cKDTree(others).query(points)[0]
