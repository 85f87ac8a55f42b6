"""Novelty by likelihood: a component is novel when the other scan's mixture does not explain its points.

A cell of points scores s = log p(cell | its own scan) - log p(cell | the other scan), nats: how much better the scan's
own mixture explains it. What the score may be without any change is measured on the other scan alone: its cells are
dealt to two halves, each half gets its own mixture, and every cell is scored by the mixture of its half against that
of the other half. Neighbouring cells are correlated, so whole blocks of them are dealt and not single ones. Both halves
were sampled from one place; what another viewpoint adds is read off the scores of all components, most of which stay.

A component is novel when half of its points score high enough to matter, and when a score as high is so rare among the
cells of the halves that the false discovery rate over all components of the scan holds (Benjamini & Hochberg 1995).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import torch
from pydantic import Field
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.distances import mean_distance
from gmmtorch.evaluation import Posterior
from novelty.detectors.base import Comparison, ComponentNovelty, Detector
from novelty.detectors.coupling import fit_coupled
from novelty.detectors.empty import empty_side_notes
from novelty.detectors.held_out import DealtCells, HeldOutScores
from novelty.detectors.p_values import discoveries, least_p_value
from novelty.detectors.quantiles import MAD_TO_STD, weighted_quantiles
from novelty.detectors.resolution import blurred, cell_resolution
from novelty.fitting import FitPlan, Models, fit_independently
from novelty.preprocess.prepared import PreparedPairs
from novelty.section import section


@section
class Likelihood(Detector):
    """A component is novel when the other scan's mixture does not explain its points (beyond the paper)."""

    fits: Literal["coupled", "independent"] = Field(
        default="coupled",
        description="Whether both scans start from one common mixture, with components of their own where the other "
        "scan explains them worst, or each is fitted on its own.",
    )
    coupled_iterations: int = Field(
        default=1, ge=0, description="EM iterations of each scan from the common mixture of `coupled` fits."
    )
    false_discovery_rate: float = Field(
        default=0.05,
        gt=0,
        lt=1,
        description="Expected share of unchanged components among those called novel (Benjamini and Hochberg).",
    )
    explained_share: float = Field(
        default=0.1,
        gt=0,
        lt=1,
        description="A point counts as unexplained where the other scan's mixture gives it less than this share of the "
        "density that its own scan's mixture gives it.",
    )
    quorum: float = Field(
        default=0.5,
        gt=0,
        le=1,
        description="Share of a component's points that must be unexplained to make it novel.",
    )
    min_cells: int = Field(
        default=5,
        ge=1,
        description="A component of fewer cells is never novel: a few cells that straddle a gap are no evidence. "
        "Blocks of held-out cells are as large.",
    )
    resolution_floor: Literal["cell", "none"] = Field(
        default="cell",
        description="Spread added to every component before points are scored: the size of a cell, since nothing "
        "finer than the sampling is a change, or none.",
    )

    def fit(self, batch: PreparedPairs, plan: FitPlan) -> Models:
        """Fit both scans of every pair, from a common mixture unless asked otherwise."""
        if self.fits == "independent":
            return fit_independently(batch, plan)
        return fit_coupled(batch, plan, self.coupled_iterations)

    def compare(self, batch: PreparedPairs, models: Models) -> Comparison:
        """Score the cells of each scan under the mixtures of both."""
        resolution = self._resolution(batch)
        reference, current = (
            _Side.of(DealtCells.of(scans.cells, self.min_cells), fit.mixtures, resolution)
            for scans, fit in ((batch.reference, models.reference), (batch.current, models.current))
        )
        added = self._judge(batch, reference, current)
        removed = self._judge(batch.exchanged(), current, reference)
        return Comparison(
            added=added,
            removed=removed,
            distance=torch.full_like(batch.current.cell_size, torch.nan),
            p_value=least_p_value(added, removed),
            notes=empty_side_notes(batch),
        )

    def _judge(self, batch: PreparedPairs, reference: _Side, current: _Side) -> ComponentNovelty:
        """Judge the current mixtures' components against the reference."""
        cells, mixtures = current.dealt.cells, current.mixtures
        explained = reference.mixtures.posterior(cells)
        scores = current.posterior.log_prob - explained.log_prob  # (N,)
        scores = torch.where(scores.isfinite(), scores, torch.nan)  # a mixture is empty
        # A component's score: what the quorum of its points reaches.
        groups = _component_of_cells(cells, mixtures, current.posterior)
        groups = torch.where(scores.isnan(), -1, groups)
        reached = _per_component(scores, cells, mixtures, groups, 1 - self.quorum)  # (P, K)
        # How probable that is without a change.
        null = HeldOutScores.of(
            reference.dealt, reference.mixtures, reference.posterior, reference.resolution, self.min_cells
        )
        # Few cells and scores that do not matter are no novelty, however rare; what has too few is not tested.
        tested = _count_per_component(groups, mixtures) >= self.min_cells
        p_values = null.p_values(reached, _stray(torch.where(tested, reached, torch.nan)))
        enough = discoveries(torch.where(tested, p_values, torch.nan), self.false_discovery_rate)
        excess = reached + math.log(self.explained_share)
        excess = torch.where(enough, excess, excess.clamp_max(0.0))
        novel = excess > 0
        slots = reference.mixtures.num_slots
        claims = _common_claims(cells, groups, mixtures, explained, slots)  # (P, K, K')
        matches, distances = _best_explanations(claims, mixtures, reference.mixtures, novel)
        of_points = partial(_of_points, current.dealt, batch.current.cell_of_point)
        return ComponentNovelty(
            novel=novel,
            scores=excess,
            matches=matches,
            distances=distances,
            reasons=self._reasons(mixtures, excess, p_values, matches, distances),
            point_scores=of_points(scores + math.log(self.explained_share)),
            p_values=p_values,
            point_p_values=of_points(null.p_values_of(scores, cells)),
        )

    def _resolution(self, batch: PreparedPairs) -> Tensor:
        """Standard deviation of the floor, m (P,)."""
        resolution = cell_resolution(batch)
        return torch.zeros_like(resolution) if self.resolution_floor == "none" else resolution

    def _reasons(
        self, mixtures: GaussianMixtures, excess: Tensor, p_values: Tensor, matches: Tensor, distances: Tensor
    ) -> tuple[tuple[str, ...], ...]:
        rows = zip(
            mixtures.num_components.tolist(),
            *(values.tolist() for values in (excess, p_values, matches, distances)),
            strict=True,
        )
        return tuple(
            tuple(self._reason(*told) for told in zip(*(row[:k] for row in told_of), strict=True))
            for k, *told_of in rows
        )

    def _reason(self, excess: float, p_value: float, match: int, distance: float) -> str:
        if math.isnan(excess):
            return "Claims no points, or there is nothing to compare it with."
        if excess > 0:
            return (
                f"Novel: the other mixture gives {self.quorum:.0%} of its points less than {self.explained_share:.0%} "
                f"of the density they have here, by {excess:.3g} nats or more; without a change p = {p_value:.2g}."
            )
        kept = (
            f"p = {p_value:.2g} without a change" if excess == 0 else f"{-excess:.3g} nats from being novel"
        )
        if match < 0:
            return f"The other mixture explains its points: {kept}."
        return f"Explained by component {match} of the other mixture, {distance:.3g} m away: {kept}."


@dataclass(frozen=True, eq=False)
class _Side:
    """One scan of every pair: its cells, its mixtures with the resolution floor, and what these say of the cells."""

    dealt: DealtCells
    mixtures: GaussianMixtures
    posterior: Posterior
    resolution: Tensor

    @classmethod
    def of(cls, dealt: DealtCells, mixtures: GaussianMixtures, resolution: Tensor) -> _Side:
        """Evaluate the mixtures once for both directions."""
        floored = replace(mixtures, covariances=blurred(mixtures.covariances, resolution))
        return cls(dealt, floored, floored.posterior(dealt.cells), resolution)


def _of_points(dealt: DealtCells, cell_of_point: Tensor, values: Tensor) -> Tensor:
    """Values of dealt cells, for the points of the cells (N,)."""
    return dealt.restored(values).index_select(0, cell_of_point)


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


def _stray(scores: Tensor) -> Tensor:
    """How far the scores of components (P, K) stray from their median, robust, as a standard deviation (P,), nats.

    The two halves of a scan are sampled from one place and the two scans may be from two, where surfaces are seen from
    another side and at another density. That shifts all scores, and most components have not changed.
    """
    apart = (scores - scores.nanmedian(dim=1, keepdim=True).values).abs()
    return MAD_TO_STD * apart.nanmedian(dim=1).values.nan_to_num(0.0)


def _count_per_component(groups: Tensor, mixtures: GaussianMixtures) -> Tensor:
    """Cells that each component claims (P, K)."""
    P, K = mixtures.weights.shape
    return torch.bincount(groups[groups >= 0], minlength=P * K).reshape(P, K)


def _common_claims(
    cells: PointClouds, groups: Tensor, mixtures: GaussianMixtures, explained: Posterior, slots: int
) -> Tensor:
    """Points that a component of one mixture and one of the other claim both (P, K, K'), `slots` being K'."""
    P, K = mixtures.weights.shape
    both = (groups >= 0) & (explained.components >= 0)
    place = torch.where(both, groups * slots + explained.components, 0)
    weights = torch.where(both, cells.weights, 0.0)
    return torch.bincount(place, weights, minlength=P * K * slots).reshape(P, K, slots)


def _best_explanations(
    claims: Tensor, mixtures: GaussianMixtures, explaining: GaussianMixtures, novel: Tensor
) -> tuple[Tensor, Tensor]:
    """For components (P, K) that are not novel: the other component that claims most of their points."""
    most, matches = claims.max(dim=2)
    matched = (most > 0) & ~novel & mixtures.mask
    table = mean_distance(mixtures.means, explaining.means)  # (P, K, K')
    distances = table.gather(2, matches[..., None]).squeeze(2)
    return torch.where(matched, matches, -1), torch.where(matched, distances, torch.nan)
