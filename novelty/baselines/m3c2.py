"""Novelty by M3C2: distance along the surface normal beyond its level of detection (Lague et al. 2013).

The computation is py4dgeo's, an optional dependency.
"""

from __future__ import annotations

import logging
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial import cKDTree

from novelty.baselines.base import PointBaseline
from novelty.errors import MissingDependencyError
from novelty.section import section


@section
class M3C2(PointBaseline):
    """Points whose distance along the normal is significant at 95 % are novel (baseline, Lague et al. 2013)."""

    normal_radius: float = Field(
        default=0.08, gt=0, description="Radius of the neighbourhood that gives a point's normal, m."
    )
    cylinder_radius: float = Field(
        default=0.04,
        gt=0,
        description="Radius of the cylinder along the normal in which both scans are averaged, m.",
    )
    core_spacing: float = Field(
        default=0.02,
        gt=0,
        description="Edge of the voxels of which each gives one core point, m; points follow the nearest core point.",
    )
    max_distance: float = Field(
        default=0.1,
        gt=0,
        description="Half the length of the cylinder, m; a point is novel when the other scan has none in it.",
    )
    registration_error: float = Field(
        default=0.01, ge=0, description="Added to the level of detection, m; it counts 1.96 times."
    )

    @property
    def threshold(self) -> float:
        """The level of detection is part of the score."""
        return 0.0

    def scores(self, points: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance along the normal minus its level of detection, m (N,); `max_distance` without a counterpart."""
        py4dgeo = _load_py4dgeo()
        cores = points[self._core_points(points)]
        distances, uncertainties = py4dgeo.M3C2(
            epochs=(py4dgeo.Epoch(points.copy()), py4dgeo.Epoch(others.copy())),
            corepoints=cores,
            normal_radii=[self.normal_radius],
            cyl_radius=self.cylinder_radius,
            max_distance=self.max_distance,
            registration_error=self.registration_error,
        ).run()
        excess = np.abs(distances) - np.nan_to_num(uncertainties["lodetection"])
        scores = np.where(np.isnan(distances), self.max_distance, excess)
        return scores[cKDTree(cores).query(points)[1]]

    def _core_points(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The first point of every voxel, as rows of `points`."""
        voxels = np.floor(points / self.core_spacing)
        return np.sort(np.unique(voxels, axis=0, return_index=True)[1])


def _load_py4dgeo() -> ModuleType:
    """Import py4dgeo, without its messages on the terminal and in a file of the working directory.

    Raises:
        MissingDependencyError: It is not installed.
    """
    try:
        import py4dgeo
    except (ImportError, OSError) as error:
        raise MissingDependencyError(
            f"The baseline m3c2 needs py4dgeo, which cannot be loaded: {error}. "
            "Run: pip install 'novelty-gmm[baselines]'"
        ) from error
    logger = logging.getLogger("py4dgeo")
    for handler in logger.handlers[:]:
        logger.removeHandler(handler)
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    return py4dgeo
