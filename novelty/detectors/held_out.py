"""Scores without any change, measured on one scan: the mixture of one half of it judged by the cells of the other."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.evaluation import Posterior
from novelty.detectors.moments import Moments, claimed_moments, mixtures_of
from novelty.detectors.p_values import NORMAL_NODES, NORMAL_WEIGHTS
from novelty.detectors.resolution import blurred

MOST_SCORED = 2000
"""Cells of a scan that are scored at most, about; the least p-value is one over their number."""


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

        A half's mixture is one M-step from the whole scan's, over its own cells alone. A component of which a half has
        less than a block is missing there because the scan was halved, and not by chance: its cells are no evidence, 0.

        Args:
            cells: P clouds.
            mixtures: their mixtures.
            posterior: of these at these cells.
            resolution: spread of every component beside that of its cells, as a standard deviation (P,) m.
            block: cells that are dealt together, neighbours in space.
        """
        first, scored = _dealt(cells, block)
        shares = (torch.where(half, cells.weights, 0.0) for half in (first, ~first))
        halves = claimed_moments(mixtures, cells, posterior.responsibilities, *shares)
        chosen, own = _members(cells, scored), first[scored]
        one, other = (_blurred(half, resolution).log_prob(chosen) for half in halves)
        scores = torch.where(own, one - other, other - one)
        scores = scores.nan_to_num(0.0)  # half of a scan without mixture: no evidence
        scores = torch.where(_in_both_halves(cells, posterior.components, first, block)[scored], scores, 0.0)
        return cls(tuple(_ascending(piece) for piece in chosen.split(scores)))

    def p_values(self, scores: Tensor, stray: Tensor) -> Tensor:
        """(1 + held-out cells that score at least as high) / (1 + held-out cells), the conformal p-value (P, K).

        Averaged over what else than chance shifts scores: normal, of the standard deviation `stray` (P,), nats.
        """
        asked = scores[..., None] - (stray[:, None] * NORMAL_NODES.to(stray))[:, None]  # (P, K, nodes)
        every = [_p_values(null, one) for null, one in zip(self.scores, asked, strict=True)]
        return torch.stack(every).to(stray) @ NORMAL_WEIGHTS.to(stray)

    def p_values_of(self, scores: Tensor, cells: PointClouds) -> Tensor:
        """The same for the scores (N,) of the cells of the scans compared."""
        return torch.cat(
            [_p_values(null, asked) for null, asked in zip(self.scores, cells.split(scores), strict=True)]
        )


def _in_both_halves(cells: PointClouds, components: Tensor, first: Tensor, least: int) -> Tensor:
    """Whether each cell is of a component that claims at least so many cells of either half (N,)."""
    slots = int(components.max()) + 1 if len(components) else 0
    places = cells.cloud_index * slots + components
    places = torch.where(components >= 0, places, len(cells) * slots)
    counts = [torch.bincount(places[half], minlength=len(cells) * slots + 1) for half in (first, ~first)]
    return (torch.minimum(*counts) >= least)[places]


def _p_values(null: Tensor, scores: Tensor) -> Tensor:
    """Conformal p-values (...,) under an ascending null (n,); NaN for NaN."""
    below = torch.searchsorted(null, scores.nan_to_num(-torch.inf).contiguous())
    return torch.where(scores.isnan(), torch.nan, (1 + len(null) - below) / (1 + len(null)))


def _ascending(values: Tensor) -> Tensor:
    """NumPy's sort, which uses vector instructions."""
    return torch.from_numpy(np.sort(values.cpu().numpy())).to(values.device)


def _blurred(moments: Moments, resolution: Tensor) -> GaussianMixtures:
    return mixtures_of(replace(moments, covariances=blurred(moments.covariances, resolution)))


def _dealt(cells: PointClouds, block: int) -> tuple[Tensor, Tensor]:
    """Which cells are of the first half, and which are scored (N,) each: blocks of neighbours are dealt in turn."""
    first = np.zeros(len(cells.points), dtype=np.bool_)
    scored = np.zeros(len(cells.points), dtype=np.bool_)
    for start, end in itertools.pairwise(cells.offsets):
        if start == end:
            continue
        order = start + np.argsort(_morton_codes(cells.points[start:end].cpu().numpy()))
        number = np.arange(end - start) // block
        first[order] = number % 2 == 0
        scored[order] = number // 2 % -(-(end - start) // MOST_SCORED) == 0
    return torch.from_numpy(first).to(cells.device), torch.from_numpy(scored).to(cells.device)


def _morton_codes(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Places of points (n, 3) along a curve on which neighbours in space mostly stand together (n,) (Morton 1966).

    Coordinates as 10-bit integers, whose bits alternate.
    """
    columns = np.ascontiguousarray(points.T)  # (3, n)
    columns = columns - columns.min(axis=1, keepdims=True)
    codes = (columns * (1023 / (columns.max() or 1.0))).astype(np.int32)
    for shift, mask in _SPREADING:
        codes = (codes | codes << shift) & mask
    return codes[0] | codes[1] << 1 | codes[2] << 2


_SPREADING = ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249))
"""Shifts and masks that put two empty bits between the 10 bits of an integer."""


def _members(cells: PointClouds, chosen: Tensor) -> PointClouds:
    """The chosen cells of every cloud."""
    sizes = torch.stack([piece.sum() for piece in cells.split(chosen)]).tolist()
    spreads = None if cells.spreads is None else cells.spreads[chosen]
    offsets = tuple(itertools.accumulate(sizes, initial=0))
    return PointClouds(cells.points[chosen], cells.weights[chosen], spreads, offsets, cells.dtype)
