"""Novelty by greedy removals: the components that keep one mixture away from the other (section 2.4.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import torch
from pydantic import Field
from torch import Tensor

from gmmtorch import GaussianMixtures
from gmmtorch.removals import Removals, greedy_removals
from gmmtorch.transport import emd
from novelty.detectors.base import Comparison, ComponentNovelty, Detector
from novelty.detectors.coupling import fit_coupled
from novelty.detectors.empty import empty_side_notes
from novelty.detectors.ground import UNITS, GroundDistanceName, ground_distances
from novelty.detectors.resolution import blurred, cell_resolution
from novelty.fitting import FitPlan, Models, fit_independently
from novelty.preprocess.prepared import PreparedPairs
from novelty.section import section


@section
class GreedyEmd(Detector):
    """Components whose removal brings the mixtures closer are novel (Algorithm 2, eq. 8)."""

    fits: Literal["coupled", "independent"] = Field(
        default="coupled",
        description="Whether both scans start from one common mixture, so that they are cut alike, or each is fitted "
        "on its own, as in the paper.",
    )
    coupled_iterations: int = Field(
        default=1, ge=0, description="EM iterations of each scan from the common mixture of `coupled` fits."
    )
    ground_distance: GroundDistanceName = Field(
        default="hellinger",
        description="Distance between components: hellinger (overlap, 0 to 1), mean (the paper's, m), bures (m), or "
        "combined (eq. 9).",
    )
    length_scale: float = Field(
        default=1.0,
        gt=0,
        description="Metres that weigh as much as one unit of eq. 10 in the combined distance.",
    )
    resolution_floor: Literal["cell", "none"] = Field(
        default="cell",
        description="Spread added to every component before distances are taken: the size of a cell, or none.",
    )
    until: Literal["work", "distance"] = Field(
        default="work",
        description="What ends the removals by rising: the work of carrying the weight that remains, or, as in the "
        "paper, the distance, for which it is scaled to 1, so that what was added hides what is gone.",
    )
    tolerance: float = Field(
        default=1e-9,
        ge=0,
        description="A rise up to this share of the largest ground distance is no rise.",
    )

    def fit(self, batch: PreparedPairs, plan: FitPlan) -> Models:
        """Fit both scans of every pair, from a common mixture unless asked otherwise."""
        if self.fits == "independent":
            return fit_independently(batch, plan)
        return fit_coupled(batch, plan, self.coupled_iterations)

    def compare(self, batch: PreparedPairs, models: Models) -> Comparison:
        """Remove what keeps each mixture away from the other, in both directions."""
        reference, current = models.reference.mixtures, models.current.mixtures
        cost = self._cost(batch, current, reference)  # (P, K, K')
        # Eq. 8: how far apart the two mixtures are.
        apart = emd(current.weights, reference.weights, cost)
        # Algorithm 2, and the same with the roles exchanged.
        gone_cost, gone_plan = cost.transpose(1, 2), apart.plan.transpose(1, 2)
        removals = partial(greedy_removals, tolerance=self.tolerance, until=self.until)
        added = removals(current.weights, reference.weights, cost)
        removed = removals(reference.weights, current.weights, gone_cost)
        return Comparison(
            added=self._told(_Direction(current, cost, apart.plan, added)),
            removed=self._told(_Direction(reference, gone_cost, gone_plan, removed)),
            distance=apart.distance,
            p_value=torch.full_like(apart.distance, torch.nan),
            notes=empty_side_notes(batch),
        )

    def _cost(self, batch: PreparedPairs, a: GaussianMixtures, b: GaussianMixtures) -> Tensor:
        if self.resolution_floor == "cell":
            resolution = cell_resolution(batch)
            a, b = (replace(m, covariances=blurred(m.covariances, resolution)) for m in (a, b))
        return ground_distances(self.ground_distance, a, b, self.length_scale)

    def _told(self, direction: _Direction) -> ComponentNovelty:
        matches, distances = direction.partners()
        return ComponentNovelty(
            novel=direction.removals.removed & direction.mixtures.mask,
            scores=direction.travelled(),
            matches=matches,
            distances=distances,
            reasons=direction.reasons(UNITS[self.ground_distance], matches, distances),
        )


@dataclass(frozen=True, eq=False)
class _Direction:
    """One direction: a mixture's components (P, K), against those of the other mixture (P, K')."""

    mixtures: GaussianMixtures
    cost: Tensor  # (P, K, K')
    plan: Tensor  # (P, K, K')
    removals: Removals

    def travelled(self) -> Tensor:
        """Mean ground distance that each component's weight travels (P, K); NaN where none does."""
        carried = self.plan.sum(dim=2)
        mean = (self.plan * self.cost).sum(dim=2) / carried
        return torch.where(carried > 0, mean, torch.nan)

    def partners(self) -> tuple[Tensor, Tensor]:
        """For components that stay: where most of their weight goes, and how far that is, (P, K) each."""
        most, partner = self.plan.max(dim=2)
        kept = (most > 0) & ~self.removals.removed
        distances = self.cost.gather(2, partner[..., None]).squeeze(2)
        return torch.where(kept, partner, -1), torch.where(kept, distances, torch.nan)

    def reasons(self, unit: str, matches: Tensor, distances: Tensor) -> tuple[tuple[str, ...], ...]:
        """One sentence per component of every pair."""
        return tuple(self._reasons_of(p, unit, matches, distances) for p in range(len(self.mixtures)))

    def _reasons_of(self, p: int, unit: str, matches: Tensor, distances: Tensor) -> tuple[str, ...]:
        course = self.removals.distances[p].tolist()
        order = self.removals.order[p].tolist()
        rounds = {s: r for r, s in enumerate(order) if s >= 0}
        told = []
        for k in range(int(self.mixtures.num_components[p])):
            match, distance = int(matches[p, k]), float(distances[p, k])
            if bool(self.removals.removed[p, k]):
                r = rounds[k]
                told.append(
                    f"Novel: removed in round {r}, which brought the distance between the mixtures from "
                    f"{course[r - 1]:.3g} to {course[r]:.3g}{unit}."
                )
            elif match < 0 or math.isnan(distance):
                told.append("There is nothing to compare it with.")
            else:
                told.append(
                    f"Kept: most of its weight goes to component {match} of the other mixture, at {distance:.3g}{unit}."
                )
        return tuple(told)
