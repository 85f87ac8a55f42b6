"""What a baseline is: a plain method that the detectors are measured against, under the same conditions."""

from __future__ import annotations

import abc

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field

from gmmtorch import FitResult, GaussianMixtures, Status
from novelty.detectors.base import Comparison, Detector, PointNovelty
from novelty.detectors.empty import empty_side_notes
from novelty.fitting import FitPlan, Models
from novelty.preprocess.prepared import PreparedPairs, PreparedScans
from novelty.section import section


@section
class Baseline(Detector):
    """It shares preprocessing and registration with the detectors and is scored plain: nothing refines its labels."""

    visibility: bool = Field(
        default=False,
        description="Whether the points called novel are judged by what the other scan could see, as those of the "
        "detectors are.",
    )

    @property
    def asks_visibility(self) -> bool:
        """As `visibility` says."""
        return self.visibility

    @property
    def asks_refinement(self) -> bool:
        """Never."""
        return False


@section
class PointBaseline(Baseline):
    """A comparison of points without mixtures; a point is novel when its score is above the threshold."""

    @property
    @abc.abstractmethod
    def threshold(self) -> float:
        """Score above which a point is novel."""

    @abc.abstractmethod
    def scores(self, points: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far from the other scan every point is, higher = more novel.

        Args:
            points: (N, 3) m, N >= 1.
            others: (M, 3) m, points of the other scan, M >= 1, in the same frame.

        Returns:
            (N,).
        """

    def fit(self, batch: PreparedPairs, plan: FitPlan) -> Models:
        """Mixtures of no components: there is nothing to fit."""
        return Models(reference=_no_mixtures(len(batch)), current=_no_mixtures(len(batch)))

    def compare(self, batch: PreparedPairs, models: Models) -> Comparison:
        """Score the points of each scan against those of the other."""
        undefined = torch.full((len(batch),), torch.nan, dtype=torch.float64)
        return Comparison(
            added=self._judge(batch.current, batch.reference),
            removed=self._judge(batch.reference, batch.current),
            distance=undefined,
            p_value=undefined,
            notes=empty_side_notes(batch),
        )

    def _judge(self, scans: PreparedScans, others: PreparedScans) -> PointNovelty:
        clouds = (scans.points.split(scans.points.points), others.points.split(others.points.points))
        scores = torch.cat([self._scores(points, other) for points, other in zip(*clouds, strict=True)])
        return PointNovelty(novel=scores > self.threshold, scores=scores)

    def _scores(self, points: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
        """NaN where one side is empty: without the other scan nothing can be called novel."""
        if not len(points) or not len(others):
            return torch.full((len(points),), torch.nan, dtype=torch.float64)
        return torch.from_numpy(self.scores(points.numpy(), others.numpy()))


def _no_mixtures(pairs: int) -> FitResult:
    undefined = torch.full((pairs,), torch.nan, dtype=torch.float64)
    none = torch.zeros(pairs, dtype=torch.long)
    mixtures = GaussianMixtures(
        weights=torch.zeros(pairs, 1, dtype=torch.float64),
        means=torch.zeros(pairs, 1, 3, dtype=torch.float64),
        covariances=torch.eye(3, dtype=torch.float64).expand(pairs, 1, 3, 3),
        num_components=none,
    )
    return FitResult(
        mixtures=mixtures,
        mdl=undefined,
        mdl_path=undefined[:, None],
        log_likelihood=undefined,
        status=torch.full_like(none, int(Status.OK)),
        num_iterations=none,
    )
