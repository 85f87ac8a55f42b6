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
from novelty.detectors.moments import claimed_moments, mixtures_of
from novelty.detectors.p_values import NORMAL_NODES, NORMAL_WEIGHTS
from novelty.detectors.resolution import blurred

MOST_SCORED = 2000
"""Cells of a scan that are scored at most, about."""

LEAST_TAIL = 10
TAIL_SHARE = 0.01
"""The tail of the scores is modelled above a hundredth of them, ten at least: it is rarely reached without a change."""


@dataclass(frozen=True, eq=False)
class DealtCells:
    """The cells of P scans dealt to two halves, in an order in which every half stands together.

    Attributes:
        order: int64 (N,), the row that each cell had before.
        cells: P clouds; of every scan its first half, then its second, each with the cells to be scored in front.
        halves: the same cells as 2 P clouds.
        scored: how many cells of each of these are scored (2 P,).
    """

    order: Tensor
    cells: PointClouds
    halves: PointClouds
    scored: tuple[int, ...]

    @classmethod
    def of(cls, cells: PointClouds, block: int) -> DealtCells:
        """Deal blocks of `block` cells in turn, neighbours in space."""
        orders, sizes = [np.empty(0, np.int64)], []
        for start, end in itertools.pairwise(cells.offsets):
            near = _along_curve(cells.points[start:end].cpu().numpy())
            number = np.arange(end - start) // block
            every = max(1, -(-(end - start) // MOST_SCORED))
            not_scored = number // 2 % every > 0
            place = (2 * (number % 2) + not_scored).astype(np.int8)
            orders.append(start + near[np.argsort(place, kind="stable")])
            sizes.append(np.bincount(place, minlength=4))
        order = torch.from_numpy(np.concatenate(orders)).to(cells.device)
        dealt = replace(
            cells,
            points=cells.points.index_select(0, order),
            weights=cells.weights.index_select(0, order),
            spreads=None if cells.spreads is None else cells.spreads.index_select(0, order),
        )
        quarters = np.reshape(sizes, (-1, 2))  # (2 P, 2): what is scored of a half, and the rest
        bounds = (0, *quarters.sum(1).cumsum().tolist())
        return cls(order, dealt, replace(dealt, offsets=bounds), tuple(quarters[:, 0].tolist()))

    def restored(self, values: Tensor) -> Tensor:
        """Values of the cells dealt (N,) in the order that the cells had before."""
        return torch.empty_like(values).index_copy_(0, self.order, values)

    def scored_of(self, values: Tensor) -> Tensor:
        """The rows of the cells that are scored, of values (N, ...)."""
        starts = self.halves.offsets
        return torch.cat(
            [values[start : start + size] for start, size in zip(starts, self.scored, strict=False)]
        )

    @property
    def scored_cells(self) -> PointClouds:
        """The cells that are scored, P clouds."""
        sizes = np.add(self.scored[::2], self.scored[1::2])
        return replace(
            self.cells,
            points=self.scored_of(self.cells.points),
            weights=self.scored_of(self.cells.weights),
            spreads=None if self.cells.spreads is None else self.scored_of(self.cells.spreads),
            offsets=(0, *sizes.cumsum().tolist()),
        )


@dataclass(frozen=True, eq=False)
class HeldOutScores:
    """What cells of P scans score when the other scan is the other half of their own, ascending, a tensor per scan."""

    scores: tuple[Tensor, ...]

    @classmethod
    def of(
        cls,
        dealt: DealtCells,
        mixtures: GaussianMixtures,
        posterior: Posterior,
        resolution: Tensor,
        least_cells: int,
    ) -> HeldOutScores:
        """Score the cells of each half by the mixtures of both.

        A half's mixture is one M-step from the whole scan's, over its own cells alone. A component of which a half has
        too few cells is missing there because the scan was halved, and not by chance: its cells are no evidence, 0.

        Args:
            dealt: the cells of P scans.
            mixtures: their mixtures.
            posterior: of these at the cells dealt.
            resolution: spread of every component beside that of its cells, as a standard deviation (P,) m.
            least_cells: of a component in either half.
        """
        whole = mixtures.select([row // 2 for row in range(2 * len(mixtures))])
        moments = claimed_moments(whole, dealt.halves, posterior.responsibilities)
        spread = resolution.repeat_interleave(2)
        halves = mixtures_of(replace(moments, covariances=blurred(moments.covariances, spread)))
        cells = dealt.scored_cells
        first, second = (halves.select(range(half, len(halves), 2)).log_prob(cells) for half in (0, 1))
        own_first = torch.arange(len(dealt.scored)) % 2 == 0
        own_first = own_first.repeat_interleave(torch.tensor(dealt.scored)).to(first.device)
        scores = torch.where(own_first, first - second, second - first)
        scores = scores.nan_to_num(0.0)  # half of a scan without mixture: no evidence
        scores = torch.where(_in_both_halves(dealt, posterior.components, least_cells), scores, 0.0)
        return cls(tuple(_ascending(piece) for piece in cells.split(scores)))

    def p_values(self, scores: Tensor, stray: Tensor) -> Tensor:
        """How probable scores as high (P, K) are without a change, see `tail_p_values`.

        Averaged over what else than chance shifts scores: normal, of the standard deviation `stray` (P,), nats.
        """
        asked = scores[..., None] - (stray[:, None] * NORMAL_NODES.to(stray))[:, None]  # (P, K, nodes)
        every = [tail_p_values(null, one) for null, one in zip(self.scores, asked, strict=True)]
        return torch.stack(every).to(stray) @ NORMAL_WEIGHTS.to(stray)

    def p_values_of(self, scores: Tensor, cells: PointClouds) -> Tensor:
        """The same for the scores (N,) of the cells of the scans compared."""
        return torch.cat(
            [tail_p_values(null, asked) for null, asked in zip(self.scores, cells.split(scores), strict=True)]
        )


def _in_both_halves(dealt: DealtCells, components: Tensor, least: int) -> Tensor:
    """Whether each scored cell is of a component that claims at least so many cells of either half."""
    slots = int(components.max()) + 2 if len(components) else 1  # the last one: of no component
    components = torch.where(components >= 0, components, slots - 1)
    owner = dealt.halves.cloud_index
    counts = torch.bincount(owner * slots + components, minlength=len(dealt.halves) * slots)
    enough = counts.reshape(-1, 2, slots).amin(1) >= least  # (P, slots)
    enough[:, -1] = False
    places = dealt.scored_of(owner // 2 * slots + components)
    return enough.flatten().index_select(0, places)


def tail_p_values(null: Tensor, scores: Tensor) -> Tensor:
    """P-values (...,) of scores in nats under an ascending null (n,); NaN for NaN.

    (1 + m) / (1 + n) where m of n scores of the null are at least as high, the conformal p-value. A scan of 200 cells
    would never find less than 0.005 so, however great the change. Above the highest hundredth of the null's scores, of
    ten at least, p falls from there exponentially by their mean excess (Knijnenburg et al. 2009), one nat or more: less
    likely by t nats than under another model are at most exp(-t) of what this one draws (Markov's inequality).
    """
    asked = scores.nan_to_num(-torch.inf).flatten().cpu().numpy()
    order = np.argsort(asked)  # neighbours are looked up in a fraction of the time
    below = np.empty(len(asked))
    below[order] = np.searchsorted(null.cpu().numpy(), asked[order])
    p_values = (1 + len(null) - torch.from_numpy(below).to(scores)) / (1 + len(null))
    in_tail = max(LEAST_TAIL, int(TAIL_SHARE * len(null)))
    if len(null) >= 2 * in_tail:
        edge = null[-in_tail]
        excess = (null[-in_tail:] - edge).mean().clamp_min(1.0)
        beyond = torch.from_numpy(asked).to(scores) - edge
        tail = (1 + in_tail) / (1 + len(null)) * (-beyond / excess).exp()
        p_values = torch.where(beyond > 0, tail, p_values)
    return torch.where(scores.isnan(), torch.nan, p_values.reshape(scores.shape))


def _ascending(values: Tensor) -> Tensor:
    """NumPy's sort, which uses vector instructions."""
    return torch.from_numpy(np.sort(values.cpu().numpy())).to(values.device)


def _along_curve(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Order of points (n, 3) along a curve on which neighbours in space mostly stand together (n,) (Morton 1966).

    Coordinates as 10-bit integers, whose bits alternate.
    """
    if not len(points):
        return np.empty(0, np.int64)
    columns = np.ascontiguousarray(points.T)  # (3, n)
    columns = columns - columns.min(axis=1, keepdims=True)
    codes = (columns * (1023 / (columns.max() or 1.0))).astype(np.int32)
    for shift, mask in _SPREADING:
        codes = (codes | codes << shift) & mask
    return np.argsort(codes[0] | codes[1] << 1 | codes[2] << 2)


_SPREADING = ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249))
"""Shifts and masks that put two empty bits between the 10 bits of an integer."""
