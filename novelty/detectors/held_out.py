"""Scores without any change, measured on one scan: the mixture of one half of it judged by the cells of the other."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.evaluation import Posterior
from novelty.detectors.moments import claimed_moments, mixtures_of
from novelty.detectors.quantiles import grouped_order
from novelty.detectors.resolution import blurred

MOST_SCORED = 2000
"""Cells of a scan that are scored, about; the least p-value is one over their number."""


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
        first, scored = _dealt(cells, block)
        claims = posterior.responsibilities * cells.weights[:, None]
        of_first = torch.where(first[:, None], claims, 0.0)
        moments = claimed_moments(mixtures, cells, torch.cat([of_first, claims - of_first], 1))
        moments = replace(moments, covariances=blurred(moments.covariances, resolution))
        chosen, own = _members(cells, scored), first[scored]
        one, other = (mixtures_of(half).log_prob(chosen) for half in moments.split(mixtures.num_slots))
        scores = torch.where(own, one - other, other - one)
        scores = scores.nan_to_num(0.0)  # half of a scan without mixture: no evidence
        return cls(chosen.split(scores[grouped_order(scores, chosen.cloud_index)]))

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


def _dealt(cells: PointClouds, block: int) -> tuple[Tensor, Tensor]:
    """Which cells are of the first half, and which are scored (N,) each: blocks of neighbours are dealt in turn."""
    first = torch.zeros(len(cells.points), dtype=torch.bool)
    scored = torch.zeros(len(cells.points), dtype=torch.bool)
    for start, end in itertools.pairwise(cells.offsets):
        if end > start:
            # The leaves of a kd-tree, in its own order: neighbours in space stand together.
            points = cells.points[start:end].cpu().numpy()
            tree = cKDTree(points, leafsize=2 * block, compact_nodes=False, balanced_tree=False)
            order = start + torch.from_numpy(tree.indices)
            number = torch.arange(end - start) // block
            first[order] = number % 2 == 0
            scored[order] = number // 2 % max(1, (end - start) // MOST_SCORED) == 0
    return first.to(cells.device), scored.to(cells.device)


def _members(cells: PointClouds, chosen: Tensor) -> PointClouds:
    """The chosen cells of every cloud."""
    sizes = torch.stack([piece.sum() for piece in cells.split(chosen)]).tolist()
    spreads = None if cells.spreads is None else cells.spreads[chosen]
    offsets = tuple(itertools.accumulate(sizes, initial=0))
    return PointClouds(cells.points[chosen], cells.weights[chosen], spreads, offsets, cells.dtype)
