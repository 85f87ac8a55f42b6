"""Novelty by fuzzy clusters: Lomenie's partition of a scan in the place of the mixture (section 3.4)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gmmtorch import GaussianMixtures, PointClouds
from novelty.baselines.fuzzy_clustering import fit_fuzzy_partitions
from novelty.baselines.mixture_baseline import MixtureBaseline
from novelty.fitting import FitPlan
from novelty.section import section


@section
class FuzzyPartition(MixtureBaseline):
    """Fuzzy clusters, compared as the components of a mixture are (baseline UFP-ONC; Gath & Geva 1989)."""

    validity: Literal["hypervolume", "average_density", "density", "none"] = Field(
        default="density",
        description="What chooses the number of clusters: the greatest partition density (density) or its average over "
        "the clusters, the least fuzzy hypervolume; none: always as many as allowed.",
    )
    max_clusters: int = Field(default=9, ge=1, description="Most clusters of a scan; the paper tries 1 to 9.")
    tolerance: float = Field(
        default=0.01, gt=0, description="Change of a membership below which the clusters have settled."
    )
    max_iterations: int = Field(
        default=100, ge=1, description="Updates per algorithm and number of clusters."
    )

    def cluster(self, clouds: PointClouds, plan: FitPlan) -> GaussianMixtures:
        """The fuzzy clusters of every cloud, as many as the validity says."""
        found = fit_fuzzy_partitions(
            clouds, self.max_clusters, tolerance=self.tolerance, max_iterations=self.max_iterations
        )
        return found.mixtures[-1] if self.validity == "none" else found.taken(found.best(self.validity))
