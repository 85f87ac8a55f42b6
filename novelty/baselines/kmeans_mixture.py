"""Novelty by k-means: its clusters in the place of the mixture's components."""

from __future__ import annotations

import torch
from pydantic import Field

from gmmtorch import GaussianMixtures, PointClouds
from novelty.baselines.clustered import clustered_mixtures
from novelty.baselines.mixture_baseline import MixtureBaseline
from novelty.fitting import FitPlan
from novelty.section import section


@section
class KMeansMixture(MixtureBaseline):
    """K_max clusters of k-means, compared as the components of a mixture are (baseline; Lloyd 1982)."""

    n_init: int = Field(
        default=1, ge=1, description="Starts of k-means per scan; the tightest clusters are kept."
    )

    def cluster(self, clouds: PointClouds, plan: FitPlan) -> GaussianMixtures:
        """The K_max clusters of every cloud by scikit-learn's k-means; fewer where there are fewer points."""
        orders, seeds = plan.per_scan(sides=2)
        sizes = [orders] * len(clouds) if isinstance(orders, int) else orders
        seeds = [seeds] * len(clouds) if isinstance(seeds, int) else seeds
        parts = zip(clouds.split(clouds.points), clouds.split(clouds.weights), sizes, seeds, strict=True)
        hard = [self._memberships(*part, slots=max(sizes)) for part in parts]
        return clustered_mixtures(clouds, torch.cat(hard))

    def _memberships(
        self, points: torch.Tensor, weights: torch.Tensor, clusters: int, seed: int, slots: int
    ) -> torch.Tensor:
        """1 for the cluster that each point belongs to, 0 for the others (N, slots)."""
        from sklearn.cluster import KMeans

        memberships = points.new_zeros(len(points), slots)
        if len(points):
            search = KMeans(min(clusters, len(points)), n_init=self.n_init, random_state=seed)
            labels = search.fit_predict(points.numpy(), sample_weight=weights.numpy())
            memberships[torch.arange(len(points)), torch.from_numpy(labels).long()] = 1.0
        return memberships
