"""Fig. 4: how many points the simplification keeps, on flat ground and on curved, for several limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from gmmtorch import PointClouds
from novelty.config import Config
from novelty.preprocess.principal import principal_axes
from novelty.preprocess.simplify import Scale, Simplified, simplify
from novelty.reproduction.scoring import Outcome, shortened, simulated
from novelty.simulation.experiments import load_experiment

LIMIT = 0.001
"""sigma_max of the picture: above the noise of flat ground, below the curvature of the hills and of the whole cloud."""

NEIGHBOURS = 30
"""Points whose surface variation (eq. 1) says how curved the surface is at a point."""


@dataclass(frozen=True)
class SimplificationRow:
    """What one limit leaves of one cloud.

    Attributes:
        kept: Share of the points that are kept.
        kept_flat: The same among the half of the points where the surface is flattest.
        kept_curved: The same among the tenth where it is most curved.
    """

    repetition: int
    max_surface_variation: float
    points: int
    kept: float
    kept_flat: float
    kept_curved: float


@dataclass(frozen=True, eq=False)
class SimplificationExample:
    """The cloud of the first repetition (N, 3) and what is left of it at `LIMIT` (M, 3), m."""

    points: NDArray[np.float64]
    kept: NDArray[np.float64]


def run_simplification(
    outcome: Outcome, repetitions: int | None = None
) -> tuple[list[SimplificationRow], SimplificationExample]:
    """Simplify every cloud of the experiment under each of its limits, all clouds in one batch."""
    experiment = shortened(load_experiment("simplification"), repetitions)
    batch = next(simulated(experiment, outcome))
    clouds = PointClouds.from_list([pair.current.points.copy() for pair in batch.bench.pairs])
    curved = [_surface_variation(pair.current.points) for pair in batch.bench.pairs]
    rows: list[SimplificationRow] = []
    for analysis in experiment.analyses:
        settings = Config().replace(**analysis.settings).preprocess
        assert settings.simplify != "none"
        scale = Scale(settings.simplify, settings.max_cell_size, settings.max_surface_variation)
        rows += _rows(simplify(clouds, scale), clouds, curved, scale.max_surface_variation)
    kept = simplify(clouds.select([0]), Scale("and", 1, LIMIT)).cells.points.numpy()
    return rows, SimplificationExample(batch.bench.pairs[0].current.points, kept)


def _rows(
    simplified: Simplified, clouds: PointClouds, curved: list[NDArray[np.float64]], limit: float
) -> Iterator[SimplificationRow]:
    """One row per cloud; a point counts as kept by one over the size of its cell."""
    sizes = simplified.cells.weights[simplified.cell_of_point]
    for repetition, (share, sigma) in enumerate(zip(clouds.split(1 / sizes), curved, strict=True)):
        kept = share.numpy()
        flat, steep = sigma <= np.median(sigma), sigma >= np.quantile(sigma, 0.9)
        yield SimplificationRow(
            repetition, limit, len(kept), *(float(part.mean()) for part in (kept, kept[flat], kept[steep]))
        )


def _surface_variation(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sigma (eq. 1) of the neighbourhood of every point (N,)."""
    from scipy.spatial import cKDTree

    near = points[cKDTree(points).query(points, NEIGHBOURS)[1]]  # (N, 30, 3)
    offsets = near - near.mean(axis=1, keepdims=True)
    covariances = np.einsum("nid,nie->den", offsets, offsets) / NEIGHBOURS
    rows = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    packed = np.stack([covariances[a, b] for a, b in rows])
    return principal_axes(torch.from_numpy(packed)).surface_variation.numpy()
