"""Novelty by structure: components outside the largest set of mutually consistent matches (section 2.4.2)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import torch
from pydantic import Field
from torch import Tensor

from gmmtorch import GaussianMixtures
from gmmtorch.distances import combined_distance
from novelty.detectors.base import Comparison, ComponentNovelty, Detector
from novelty.detectors.coupling import fit_coupled
from novelty.detectors.empty import empty_side_notes
from novelty.detectors.resolution import blurred, cell_resolution
from novelty.detectors.scaled_graphs import build_scaled_graphs, scaled_distance
from novelty.fitting import FitPlan, Models, fit_independently
from novelty.matching import (
    ArcTerms,
    CliqueStatus,
    Components,
    CorrespondenceGraphs,
    Merged,
    build_correspondence_graphs,
    match_structure,
    merge_cut_components,
    unmerged,
)
from novelty.preprocess.prepared import PreparedPairs
from novelty.section import section


@section
class StructuralMatching(Detector):
    """Components outside the maximum clique of the correspondence graph are novel (eqs. 9-12)."""

    fits: Literal["coupled", "independent"] = Field(
        default="coupled",
        description="Whether both scans start from one common mixture, so that they are cut alike, or each is fitted "
        "on its own, as in the paper.",
    )
    coupled_iterations: int = Field(
        default=1, ge=0, description="EM iterations of each scan from the common mixture of `coupled` fits."
    )
    merging: bool = Field(
        default=False,
        description="Whether components that independent fits cut apart are joined before matching where together "
        "they are much nearer to a component of the other mixture; coupled fits are cut alike, and need none.",
    )
    scale: Literal["component", "metre"] = Field(
        default="component",
        description="Unit of distances between means: the components' own extent, with the relative constraint taken "
        "relative to the distances it compares, or, as in the paper, metres.",
    )
    node_threshold: float = Field(
        default=2.5,
        gt=0,
        description="U_T: two components may match below this distance (eq. 9); the paper's metres ask for 3.5.",
    )
    arc_threshold: float = Field(
        default=1.0,
        gt=0,
        description="U_R: two matches may hold together up to this difference (eq. 11); the paper's metres ask for 1.",
    )
    arc_terms: ArcTerms = Field(
        default="squared",
        description="What eq. 12 subtracts under its root: squared distances, as printed, or, in its other reading, "
        "the distances themselves (plain).",
    )
    length_scale: float = Field(
        default=1.0,
        gt=0,
        description="Metres that weigh as much as one unit of eq. 10; for the scale `metre` only.",
    )
    resolution_floor: Literal["cell", "none"] = Field(
        default="cell",
        description="Spread added to every component before eq. 10: the size of a cell, or none.",
    )
    node_budget: int = Field(
        default=20_000,
        ge=1,
        description="Steps of the clique search after which the best clique found so far is taken.",
    )

    def fit(self, batch: PreparedPairs, plan: FitPlan) -> Models:
        """Fit both scans of every pair, from a common mixture unless asked otherwise."""
        if self.fits == "independent":
            return fit_independently(batch, plan)
        return fit_coupled(batch, plan, self.coupled_iterations)

    def compare(self, batch: PreparedPairs, models: Models) -> Comparison:
        """Match the components of both mixtures; one clique answers both directions."""
        reference, current = models.reference.mixtures, models.current.mixtures
        resolution = cell_resolution(batch)
        a, b = self._merged(self._components(current, resolution), self._components(reference, resolution))
        # Nodes (eq. 9) and arcs (eqs. 11-12) of every pair.
        graphs = self._graphs(a.components, b.components)
        # The largest clique: matches that hold together.
        found = match_structure(graphs, self.node_budget)
        # Components outside it are novelties; those that were joined share their answer.
        added = self._told(current, a, b, graphs.table, found.partners_a)
        removed = self._told(reference, b, a, graphs.table.transpose(1, 2), found.partners_b)
        unknown = torch.full_like(resolution, torch.nan)
        return Comparison(
            added, removed, distance=unknown, p_value=unknown, notes=_notes(batch, found.status)
        )

    def _merged(self, a: Components, b: Components) -> tuple[Merged, Merged]:
        """Both sides, with what the fits cut apart joined; each into what matches the other side best."""
        if self.fits == "coupled" or not self.merging:
            return unmerged(a), unmerged(b)
        merged_a = merge_cut_components(a, b, self._distances)
        return merged_a, merge_cut_components(b, merged_a.components, self._distances)

    def _distances(self, a: Components, b: Components) -> Tensor:
        if self.scale == "component":
            return scaled_distance(a, b)
        return combined_distance(a.means, a.covariances, b.means, b.covariances, self.length_scale)

    def _graphs(self, a: Components, b: Components) -> CorrespondenceGraphs:
        if self.scale == "component":
            return build_scaled_graphs(a, b, self.node_threshold, self.arc_threshold, self.arc_terms)
        return build_correspondence_graphs(
            a,
            b,
            node_threshold=self.node_threshold,
            arc_threshold=self.arc_threshold,
            length_scale=self.length_scale,
            terms=self.arc_terms,
        )

    def _components(self, mixtures: GaussianMixtures, resolution: Tensor) -> Components:
        if self.resolution_floor == "cell":
            mixtures = replace(mixtures, covariances=blurred(mixtures.covariances, resolution))
        return Components(mixtures.weights, mixtures.means, mixtures.covariances)

    def _told(
        self, mixtures: GaussianMixtures, side: Merged, other: Merged, table: Tensor, partners: Tensor
    ) -> ComponentNovelty:
        """Say of the components (P, K) of one side who the partners of their slots (P, K) are; table (P, K, K')."""
        there = other.components.weights > 0  # (P, K')
        comparable = mixtures.mask & there.any(1)[:, None]
        absent = ~(mixtures.mask[:, :, None] & there[:, None, :])
        table, partners = side.spread(table), side.spread(partners)
        nearest, neighbours = table.masked_fill(absent, torch.inf).min(dim=2)
        matched = partners >= 0
        to_partner = table.gather(2, partners.clamp_min(0)[..., None]).squeeze(2)
        distances = torch.where(matched, to_partner, torch.nan)
        # Below 1 for a match, above 1 without one, so that the order of scores agrees with the labels.
        scores = torch.where(matched, distances, self.node_threshold + nearest) / self.node_threshold
        return ComponentNovelty(
            novel=comparable & ~matched,
            scores=torch.where(comparable, scores, torch.nan),
            matches=partners,
            distances=distances,
            reasons=tuple(
                tuple(
                    self._reason(*told) + _company(number, group[:k])
                    for number, told in enumerate(
                        zip(partner[:k], distance[:k], near[:k], neighbour[:k], strict=True)
                    )
                )
                for k, partner, distance, near, neighbour, group in zip(
                    mixtures.num_components.tolist(),
                    partners.tolist(),
                    distances.tolist(),
                    nearest.tolist(),
                    neighbours.tolist(),
                    side.groups.tolist(),
                    strict=True,
                )
            ),
        )

    def _reason(self, partner: int, distance: float, nearest: float, neighbour: int) -> str:
        if partner >= 0:
            return f"Matched to component {partner} of the other mixture, at distance {distance:.3g} (eq. 9)."
        if math.isinf(nearest):
            return "There is nothing to compare it with."
        if nearest >= self.node_threshold:
            return (
                f"Novel: the nearest component of the other mixture, {neighbour}, is at distance {nearest:.3g}, "
                f"not below U_T = {self.node_threshold:g} (eq. 9)."
            )
        return (
            f"Novel: it could match component {neighbour} of the other mixture, at distance {nearest:.3g}, but no "
            f"such match agrees with the other matches (U_R = {self.arc_threshold:g}, eq. 11)."
        )


def _company(number: int, groups: list[int]) -> str:
    """With which components of its own mixture a component was joined before matching."""
    joined = [str(other) for other, group in enumerate(groups) if group == groups[number] and other != number]
    if not joined:
        return ""
    return f" Joined with component{'s' * (len(joined) > 1)} {', '.join(joined)} of its own mixture."


def _notes(batch: PreparedPairs, status: Tensor) -> tuple[tuple[str, ...], ...]:
    unproven = CliqueStatus.NOT_PROVEN_MAXIMAL
    searched = ((f"Not proven maximal: {unproven.advice}",) if s == unproven else () for s in status.tolist())
    return tuple(empty + clique for empty, clique in zip(empty_side_notes(batch), searched, strict=True))
