"""Novelty by unbalanced transport: mass of one mixture that finds no partner of the other within reach.

Masses are expected counts of points and are not renormalised to 1: when a large object appears, the rest keeps its
mass. Both directions come out of one transport problem: unmatched mass of the current mixture was added, unmatched
mass of the reference mixture is gone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import torch
from pydantic import Field
from torch import Tensor

from gmmtorch import GaussianMixtures
from gmmtorch.transport import UnbalancedTransport, unbalanced_emd
from novelty.detectors.balance import log_density_ratio, pooled_counts
from novelty.detectors.base import Comparison, ComponentNovelty, Detector
from novelty.detectors.coupling import fit_coupled
from novelty.detectors.empty import empty_side_notes
from novelty.detectors.ground import UNITS, GroundDistanceName, ground_distances
from novelty.detectors.resolution import blurred, cell_resolution
from novelty.detectors.shared_mixture import fit_shared
from novelty.fitting import FitPlan, Models, fit_independently
from novelty.preprocess.prepared import PreparedPairs
from novelty.section import section

LEAST_SPACING = 1e-9
"""Components may coincide; tau must be positive all the same."""


@section
class UnbalancedEmd(Detector):
    """A component is novel when transport leaves most of its points without a partner (beyond the paper)."""

    fits: Literal["shared", "coupled", "independent"] = Field(
        default="coupled",
        description="Whether both scans use the components of one mixture, start from one, or are fitted on their own.",
    )
    coupled_iterations: int = Field(
        default=1, ge=0, description="EM iterations of each scan from the common mixture of `coupled` fits."
    )
    split_distance: float = Field(
        default=0.3,
        gt=0,
        le=1,
        description="Hellinger distance (0 to 1) between the two scans' points inside one component of a `shared` "
        "mixture above which it becomes two.",
    )
    max_splits: int = Field(default=0, ge=0, description="Rounds of splits and EM of `shared` fits.")
    ground_distance: GroundDistanceName = Field(
        default="hellinger",
        description="Distance between components: hellinger (overlap, 0 to 1), mean (m), bures (m), or combined "
        "(eq. 9).",
    )
    length_scale: float = Field(
        default=1.0,
        gt=0,
        description="Metres that weigh as much as one unit of eq. 10 in the combined distance.",
    )
    reach: float = Field(
        default=0.7,
        gt=0,
        description="2 tau, the distance up to which components are partners: in units of the typical distance of a "
        "component to the nearest one of its own mixture.",
    )
    share: float = Field(
        default=0.5,
        gt=0,
        lt=1,
        description="A component is novel when more than this share of it has no partner.",
    )

    def fit(self, batch: PreparedPairs, plan: FitPlan) -> Models:
        """Fit both scans of every pair."""
        if self.fits == "independent":
            return fit_independently(batch, plan)
        if self.fits == "coupled":
            return fit_coupled(batch, plan, self.coupled_iterations)
        return fit_shared(batch, plan, self.split_distance, self.max_splits)

    def compare(self, batch: PreparedPairs, models: Models) -> Comparison:
        """Transport what both mixtures have in common; what stays behind is added or removed."""
        reference, current = models.reference.mixtures, models.current.mixtures
        seen, expected = self._floored(current, batch), self._floored(reference, batch)
        cost = self._distances(seen, expected)  # (P, K, K')
        # tau: half the distance at which a mixture's own components are neighbours.
        within = torch.cat([self._neighbours(m) for m in (seen, expected)], dim=1)  # (P, K + K')
        tau = 0.5 * self.reach * within.nanmedian(dim=1).values.nan_to_num(1.0).clamp_min(LEAST_SPACING)
        # Masses: points, both scans brought to one density.
        half = 0.5 * log_density_ratio(*pooled_counts(batch, models))
        moved = unbalanced_emd(
            _masses(current, batch.current.cells.total_weights, -half),
            _masses(reference, batch.reference.cells.total_weights, half),
            cost,
            tau,
        )
        return Comparison(
            added=self._told(_Side.of(current, cost, moved, tau)),
            removed=self._told(_Side.of(reference, cost.transpose(1, 2), _exchanged(moved), tau)),
            distance=torch.where(
                (current.num_components > 0) & (reference.num_components > 0), moved.total_cost, torch.nan
            ),
            p_value=torch.full_like(tau, torch.nan),
            notes=empty_side_notes(batch),
        )

    def _floored(self, mixtures: GaussianMixtures, batch: PreparedPairs) -> GaussianMixtures:
        return replace(mixtures, covariances=blurred(mixtures.covariances, cell_resolution(batch)))

    def _distances(self, a: GaussianMixtures, b: GaussianMixtures) -> Tensor:
        return ground_distances(self.ground_distance, a, b, self.length_scale)

    def _neighbours(self, mixtures: GaussianMixtures) -> Tensor:
        """Distance from every component to the nearest one of its own mixture (P, K); NaN for padding.

        A component that is alone has its own size, or 1 where the distance is a pure number.
        """
        apart = self._distances(mixtures, mixtures)
        itself = torch.eye(mixtures.num_slots, dtype=torch.bool, device=apart.device)
        absent = ~mixtures.mask[:, None, :] | itself
        nearest = apart.masked_fill(absent, torch.inf).amin(dim=2)
        size = mixtures.covariances.diagonal(dim1=-2, dim2=-1).sum(-1).sqrt()
        alone = size if UNITS[self.ground_distance] else torch.ones_like(size)
        return torch.where(mixtures.mask, torch.where(nearest.isfinite(), nearest, alone), torch.nan)

    def _told(self, side: _Side) -> ComponentNovelty:
        novel = side.unmatched > self.share
        matches, distances = side.partners(novel)
        return ComponentNovelty(
            novel=novel,
            scores=side.unmatched,
            matches=matches,
            distances=distances,
            reasons=tuple(
                tuple(self._reason(2 * tau, *told) for told in zip(*(row[:k] for row in rows), strict=True))
                for k, tau, *rows in zip(
                    side.mixtures.num_components.tolist(),
                    side.tau.tolist(),
                    novel.tolist(),
                    side.unmatched.tolist(),
                    matches.tolist(),
                    distances.tolist(),
                    strict=True,
                )
            ),
        )

    def _reason(self, reach: float, novel: bool, unmatched: float, match: int, distance: float) -> str:
        unit = UNITS[self.ground_distance]
        if math.isnan(unmatched):
            return "There is nothing to compare it with."
        if novel:
            return (
                f"Novel: {unmatched:.0%} of it finds no partner in the other mixture within {reach:.3g}{unit}, more "
                f"than {self.share:.0%}."
            )
        return (
            f"Kept: {1 - unmatched:.0%} of it is matched, most of that to component {match} of the other mixture, at "
            f"{distance:.3g}{unit}."
        )


@dataclass(frozen=True, eq=False)
class _Side:
    """One role of the pairs: mixtures (P, K), ground distances and plan (P, K, K').

    `unmatched` (P, K) is the share of each component without a partner; NaN where there is nothing to compare.
    """

    mixtures: GaussianMixtures
    cost: Tensor
    plan: Tensor
    unmatched: Tensor
    tau: Tensor

    @classmethod
    def of(cls, mixtures: GaussianMixtures, cost: Tensor, moved: UnbalancedTransport, tau: Tensor) -> _Side:
        """The current mixtures' side of a transport."""
        matched = moved.plan.sum(dim=2)
        comparable = mixtures.mask & (moved.unmatched_b + moved.plan.sum(dim=1) > 0).any(dim=1, keepdim=True)
        unmatched = moved.unmatched_a / (matched + moved.unmatched_a)
        return cls(mixtures, cost, moved.plan, torch.where(comparable, unmatched, torch.nan), tau)

    def partners(self, novel: Tensor) -> tuple[Tensor, Tensor]:
        """For components that are not novel: where most of their mass goes, and how far that is (P, K) each."""
        most, partner = self.plan.max(dim=2)
        kept = (most > 0) & ~novel
        distances = self.cost.gather(2, partner[..., None]).squeeze(2)
        return torch.where(kept, partner, -1), torch.where(kept, distances, torch.nan)


def _masses(mixtures: GaussianMixtures, points: Tensor, log_scale: Tensor) -> Tensor:
    """Points of every component times a factor per pair (P, K)."""
    return mixtures.weights * (points * log_scale.exp())[:, None]


def _exchanged(moved: UnbalancedTransport) -> UnbalancedTransport:
    """The same transport with the roles exchanged."""
    return replace(
        moved,
        plan=moved.plan.transpose(1, 2),
        unmatched_a=moved.unmatched_b,
        unmatched_b=moved.unmatched_a,
    )
