"""Scores without any change, measured on one scan: the mixture of one half of it judged by the cells of the other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.evaluation import Posterior
from novelty.detectors.moments import claimed_moments, mixtures_of
from novelty.detectors.quantiles import grouped_order
from novelty.detectors.resolution import blurred


@dataclass(frozen=True, eq=False)
class HeldOutScores:
    """What cells of P scans score when the other scan is the other half of their own, ascending, a tensor per scan."""

    scores: tuple[Tensor, ...]

    @classmethod
    def of(
        cls,
        cells: PointClouds,
        mixtures: GaussianMixtures,
        posterior: Posterior,
        resolution: Tensor,
        block: int,
    ) -> HeldOutScores:
        """Deal the cells to two halves and score each by both halves' mixtures.

        A half's mixture is one M-step from the whole scan's, over its own cells alone.

        Args:
            cells: P clouds.
            mixtures: their mixtures.
            posterior: of these at these cells.
            resolution: spread of every component beside that of its cells, as a standard deviation (P,) m.
            block: cells that are dealt together, neighbours in space.
        """
        first = _first_half(cells, block)
        log_probs = []
        for half in (first, ~first):
            claims = torch.where(half[:, None], posterior.responsibilities, 0.0) * cells.weights[:, None]
            moments = claimed_moments(mixtures, cells, claims)
            moments = replace(moments, covariances=blurred(moments.covariances, resolution))
            log_probs.append(mixtures_of(moments).log_prob(cells))
        scores = torch.where(first, log_probs[0] - log_probs[1], log_probs[1] - log_probs[0])
        scores = scores.nan_to_num(0.0)  # half of a scan without mixture: no evidence
        return cls(cells.split(scores[grouped_order(scores, cells.cloud_index)]))

    def p_values(self, scores: Tensor) -> Tensor:
        """(1 + held-out cells that score at least as high) / (1 + held-out cells), the conformal p-value (P, K)."""
        return torch.stack([_p_values(null, asked) for null, asked in zip(self.scores, scores, strict=True)])

    def p_values_of(self, scores: Tensor, cells: PointClouds) -> Tensor:
        """The same for the scores (N,) of the cells of the scans compared."""
        return torch.cat(
            [_p_values(null, asked) for null, asked in zip(self.scores, cells.split(scores), strict=True)]
        )


def _p_values(null: Tensor, scores: Tensor) -> Tensor:
    """Conformal p-values (...,) under an ascending null (n,); NaN for NaN."""
    below = torch.searchsorted(null, scores.nan_to_num(-torch.inf).contiguous())
    return torch.where(scores.isnan(), torch.nan, (1 + len(null) - below) / (1 + len(null)))


def _first_half(cells: PointClouds, block: int) -> Tensor:
    """Which cells are of the first half (N,): blocks of neighbours are dealt in turn."""
    halves = [torch.zeros(0, dtype=torch.bool)]
    for points in cells.split(cells.points):
        half = np.zeros(len(points), dtype=np.bool_)
        if len(points):
            # The leaves of a kd-tree, in its own order: neighbours in space stand together.
            order = cKDTree(points.cpu().numpy(), leafsize=2 * block).indices
            half[order] = np.arange(len(points)) // block % 2 == 0
        halves.append(torch.from_numpy(half))
    return torch.cat(halves).to(cells.device)
