"""Baselines that put another clustering in the place of the mixtures of section 2.3 and compare as Algorithm 2 does."""

from __future__ import annotations

import abc
from typing import Literal

import torch
from pydantic import Field

import gmmtorch
from gmmtorch import FitResult, GaussianMixtures, PointClouds, Status
from gmmtorch.components import Components
from novelty.baselines.base import Baseline
from novelty.detectors.base import Comparison
from novelty.detectors.greedy_emd import GreedyEmd
from novelty.detectors.ground import GroundDistanceName
from novelty.detectors.shared_mixture import packed_mixtures
from novelty.fitting import FitPlan, Models, fitted_clouds
from novelty.preprocess.prepared import PreparedPairs
from novelty.section import section


@section
class MixtureBaseline(Baseline):
    """Clusters taken for the components of a mixture, every scan on its own."""

    ground_distance: GroundDistanceName = Field(
        default="hellinger",
        description="Distance between clusters: hellinger (overlap, 0 to 1), mean (the paper's, m), bures (m), or "
        "combined (eq. 9).",
    )
    resolution_floor: Literal["cell", "none"] = Field(
        default="cell",
        description="Spread added to every cluster before distances are taken: the size of a cell, or none.",
    )

    @abc.abstractmethod
    def cluster(self, clouds: PointClouds, plan: FitPlan) -> GaussianMixtures:
        """The clusters of B clouds as B mixtures; an empty cluster has weight 0."""

    def fit(self, batch: PreparedPairs, plan: FitPlan) -> Models:
        """Cluster both scans of every pair, all 2 P of them in one batch."""
        sides = [fitted_clouds(scans, plan.settings) for scans in (batch.reference, batch.current)]
        clouds = PointClouds.concatenate(sides)
        clusters = self.cluster(clouds, plan)
        fits = _as_fit(
            packed_mixtures(Components.create(clusters.weights, clusters.means, clusters.covariances)), clouds
        )
        pairs = len(batch)
        return Models(reference=fits.select(range(pairs)), current=fits.select(range(pairs, 2 * pairs)))

    def compare(self, batch: PreparedPairs, models: Models) -> Comparison:
        """Remove what keeps each mixture away from the other (Algorithm 2)."""
        greedy = GreedyEmd(
            fits="independent",
            ground_distance=self.ground_distance,
            resolution_floor=self.resolution_floor,
            until="distance",
        )
        return greedy.compare(batch, models)


def _as_fit(mixtures: GaussianMixtures, clouds: PointClouds) -> FitResult:
    """Given mixtures as the result of a fit."""
    log_prob = mixtures.log_prob(clouds) * clouds.weights
    none = torch.zeros(len(mixtures), dtype=torch.long)
    return FitResult(
        mixtures=mixtures,
        mdl=gmmtorch.description_length(mixtures, clouds),
        mdl_path=torch.full((len(mixtures), 1), torch.nan, dtype=torch.float64),
        log_likelihood=torch.stack([part.sum() for part in clouds.split(log_prob)]),
        status=torch.where(mixtures.num_components > 0, int(Status.OK), int(Status.EMPTY)),
        num_iterations=none,
    )
