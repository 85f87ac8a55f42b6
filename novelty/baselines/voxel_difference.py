"""Novelty by voxels: a point in a voxel of a regular grid that is empty in the other scan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from novelty.baselines.base import PointBaseline
from novelty.section import section


@section
class VoxelDifference(PointBaseline):
    """Points in voxels where the other scan has no point are novel (baseline)."""

    voxel_size: float = Field(default=0.1, gt=0, description="Edge of a voxel, m.")

    @property
    def threshold(self) -> float:
        """Between 0, a voxel that both scans occupy, and 1."""
        return 0.5

    def scores(self, points: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
        """1 in a voxel where the other scan has no point, else 0 (N,)."""
        both = np.floor(np.concatenate([others, points]) / self.voxel_size)
        _, voxels = np.unique(both, axis=0, return_inverse=True)
        occupied = np.zeros(voxels.max() + 1, dtype=bool)
        occupied[voxels[: len(others)]] = True
        return (~occupied[voxels[len(others) :]]).astype(np.float64)
