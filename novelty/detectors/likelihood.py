"""Novelty by likelihood: a component is novel when the other scan's mixture does not explain its points.

A cell of points scores s = -log p(cell | reference), nats. How large a score may be without any change is read
off the reference scan's own cells: the threshold is a high quantile of their scores, a false-alarm rate and not a
length. Sparse surfaces score high in both scans; so the reference must also give the cell a small share of the
density that the current scan's own mixture gives it. A component is novel when half of its points meet both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import torch
from pydantic import Field
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.distances import mean_distance
from gmmtorch.evaluation import Posterior
from novelty.detectors.base import Comparison, ComponentNovelty, Detector
from novelty.detectors.empty import empty_side_notes
from novelty.detectors.p_values import least_p_value
from novelty.detectors.quantiles import grouped_order, weighted_quantiles
from novelty.detectors.resolution import blurred, cell_resolution
from novelty.fitting import Models
from novelty.preprocess.prepared import PreparedPairs
from novelty.section import section


@section
class Likelihood(Detector):
    """A component is novel when the other scan's mixture does not explain its points (beyond the paper)."""

    false_alarm_rate: float = Field(
        default=0.01,
        gt=0,
        lt=1,
        description="Share of the reference scan's own points that its mixture may explain worse than the threshold.",
    )
    explained_share: float = Field(
        default=0.1,
        gt=0,
        lt=1,
        description="A point is unexplained only where the reference mixture's density is below this share of the "
        "current mixture's.",
    )
    quorum: float = Field(
        default=0.5,
        gt=0,
        le=1,
        description="Share of a component's points that must lie beyond the threshold to make it novel.",
    )
    min_cells: int = Field(
        default=5,
        ge=1,
        description="A component of fewer cells is never novel: a few cells that straddle a gap are no evidence.",
    )
    resolution_floor: Literal["cell", "none"] = Field(
        default="cell",
        description="Spread added to every component before points are scored: the size of a cell, since nothing "
        "finer than the sampling is a change, or none.",
    )

    def compare(self, batch: PreparedPairs, models: Models) -> Comparison:
        """Score the cells of each scan under the other scan's mixture."""
        reference = _Scored.of(batch.reference.cells, self._floored(models.reference.mixtures, batch))
        current = _Scored.of(batch.current.cells, self._floored(models.current.mixtures, batch))
        added = self._judge(batch, models, reference, current)
        removed = self._judge(batch.exchanged(), models.exchanged(), current, reference)
        return Comparison(
            added=added,
            removed=removed,
            distance=torch.full_like(batch.current.cell_size, torch.nan),
            p_value=least_p_value(added, removed),
            notes=empty_side_notes(batch),
        )

    def _judge(
        self, batch: PreparedPairs, models: Models, reference: _Scored, seen_by: _Scored
    ) -> ComponentNovelty:
        """Judge the current mixtures' components against the reference."""
        current, mixtures = batch.current.cells, models.current.mixtures
        # How badly the reference mixture explains the cells of the current scan.
        explained = reference.mixtures.posterior(current)
        seen = -explained.log_prob  # (N_current,)
        # What a score may be without any change.
        null = _Null.of(reference.scores, batch.reference.cells)
        threshold = null.quantiles(1 - self.false_alarm_rate)[current.cloud_index]  # (N_current,)
        # What the current scan's own mixture would let a score be.
        expected = seen_by.scores - math.log(self.explained_share)
        excess = seen - torch.maximum(threshold, expected)
        # A component's score: the excess that the quorum of its points reaches.
        claimed = mixtures.posterior(current)
        groups = _component_of_cells(current, mixtures, claimed)
        scores = _per_component(excess, current, mixtures, groups, 1 - self.quorum)  # (P, K)
        enough = _count_per_component(groups, mixtures) >= self.min_cells
        scores = torch.where(enough, scores, scores.clamp_max(0.0))
        novel = scores > 0
        claims = _common_claims(current, claimed, explained)  # (P, K, K')
        matches, distances = _best_explanations(claims, mixtures, reference.mixtures, novel)
        return ComponentNovelty(
            novel=novel,
            scores=scores,
            matches=matches,
            distances=distances,
            reasons=self._reasons(mixtures, scores, matches, distances),
            point_scores=excess[batch.current.cell_of_point],
            p_values=null.p_values(_per_component(seen, current, mixtures, groups, 1 - self.quorum)),
        )

    def _floored(self, mixtures: GaussianMixtures, batch: PreparedPairs) -> GaussianMixtures:
        if self.resolution_floor == "none":
            return mixtures
        return replace(mixtures, covariances=blurred(mixtures.covariances, cell_resolution(batch)))

    def _reasons(
        self, mixtures: GaussianMixtures, scores: Tensor, matches: Tensor, distances: Tensor
    ) -> tuple[tuple[str, ...], ...]:
        rows = zip(
            mixtures.num_components.tolist(),
            scores.tolist(),
            matches.tolist(),
            distances.tolist(),
            strict=True,
        )
        return tuple(
            tuple(self._reason(*told) for told in zip(score[:k], match[:k], distance[:k], strict=True))
            for k, score, match, distance in rows
        )

    def _reason(self, score: float, match: int, distance: float) -> str:
        if math.isnan(score):
            return "Claims no points, or there is nothing to compare it with."
        if score > 0:
            return (
                f"Novel: the other mixture explains {self.quorum:.0%} of its points worse, by {score:.3g} nats or "
                f"more, than {self.false_alarm_rate:.2%} of that scan's own points, and gives them less than "
                f"{self.explained_share:.0%} of the density they have here."
            )
        if match < 0:
            return "The other mixture explains its points."
        return (
            f"Explained by component {match} of the other mixture, {distance:.3g} m away; its points are "
            f"{-score:.3g} nats from being novel."
        )


@dataclass(frozen=True, eq=False)
class _Scored:
    """Mixtures with the resolution floor, and the scores of the cells that they were fitted to (N,)."""

    mixtures: GaussianMixtures
    scores: Tensor

    @classmethod
    def of(cls, cells: PointClouds, mixtures: GaussianMixtures) -> _Scored:
        """Score the cells."""
        return cls(mixtures, -mixtures.log_prob(cells))


@dataclass(frozen=True)
class _Null:
    """Scores that the reference scans give their own cells, packed: what no change looks like."""

    scores: Tensor  # (N,)
    weights: Tensor  # (N,)
    clouds: Tensor  # (N,)
    pieces: tuple[Tensor, ...]  # the scores of each of the P clouds, ascending

    @classmethod
    def of(cls, scores: Tensor, cells: PointClouds) -> _Null:
        """The null distribution of every pair from its reference's cells."""
        ascending = scores[grouped_order(scores, cells.cloud_index)]
        return cls(scores, cells.weights, cells.cloud_index, cells.split(ascending))

    def quantiles(self, level: float) -> Tensor:
        """Score below which `level` of each reference's points lie (P,)."""
        return weighted_quantiles(self.scores, self.weights, self.clouds, len(self.pieces), level)

    def p_values(self, scores: Tensor) -> Tensor:
        """(1 + cells that score at least as high) / (1 + cells), the conformal p-value (P, K).

        Counts cells, not points: points of one cell are no independent evidence.
        """
        rows = []
        for piece, asked in zip(self.pieces, scores, strict=True):
            below = torch.searchsorted(piece, asked.nan_to_num(-torch.inf).contiguous())
            rows.append((1 + len(piece) - below) / (1 + len(piece)))
        return torch.where(scores.isnan(), torch.nan, torch.stack(rows))


def _component_of_cells(cells: PointClouds, mixtures: GaussianMixtures, claimed: Posterior) -> Tensor:
    """Place p K + k of the component that claims each cell, -1 where the mixture is empty (N,)."""
    component = claimed.components
    return torch.where(component >= 0, cells.cloud_index * mixtures.num_slots + component, -1)


def _per_component(
    values: Tensor, cells: PointClouds, mixtures: GaussianMixtures, groups: Tensor, level: float
) -> Tensor:
    """Weighted quantile of the values of every component's cells (P, K); NaN where it claims none."""
    P, K = mixtures.weights.shape
    return weighted_quantiles(values, cells.weights, groups, P * K, level).reshape(P, K)


def _count_per_component(groups: Tensor, mixtures: GaussianMixtures) -> Tensor:
    """Cells that each component claims (P, K)."""
    P, K = mixtures.weights.shape
    return torch.bincount(groups[groups >= 0], minlength=P * K).reshape(P, K)


def _common_claims(cells: PointClouds, one: Posterior, other: Posterior) -> Tensor:
    """Points that a component of one mixture and one of the other claim both, sum_n w_n r_nk r'_nk' (P, K, K')."""
    weighted = one.responsibilities.T * cells.weights  # (K, N)
    sizes = list(cells.sizes)
    pieces = zip(weighted.split(sizes, dim=1), cells.split(other.responsibilities), strict=True)
    return torch.stack([mine @ theirs for mine, theirs in pieces])


def _best_explanations(
    claims: Tensor, mixtures: GaussianMixtures, explaining: GaussianMixtures, novel: Tensor
) -> tuple[Tensor, Tensor]:
    """For components (P, K) that are not novel: the other component that claims most of their points."""
    most, matches = claims.max(dim=2)
    matched = (most > 0) & ~novel & mixtures.mask
    table = mean_distance(mixtures.means, explaining.means)  # (P, K, K')
    distances = table.gather(2, matches[..., None]).squeeze(2)
    return torch.where(matched, matches, -1), torch.where(matched, distances, torch.nan)
