"""From prepared scans to mixtures: the settings of the fit and the fit itself."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

import torch
from pydantic import Field

import gmmtorch
from gmmtorch import FitResult, GaussianMixtures, PointClouds, Status
from novelty.preprocess.prepared import PreparedPairs, PreparedScans
from novelty.section import section

T = TypeVar("T")

ADVICE = {"raise min_std": "raise fit.min_std", "; raise max_iterations": ""}
"""Advice of the engine, and what it is in terms of the configuration, which has no key for the iterations."""


@section
class Fit:
    """How the mixtures are fitted (section 2.3)."""

    moments: Literal["spread", "centroid"] = Field(
        default="spread",
        description="What a cell of simplified points tells the fit: its count, mean and spread, or, as in the "
        "paper, its centroid only.",
    )
    initializer: Literal["merged", "evenly_spaced", "random_points", "kmeans++"] = Field(
        default="merged",
        description="Where components start: a fine partition of the scan joined by eq. 7 (merged), or, as in the "
        "paper, points evenly spaced in scan order.",
    )
    n_init: int = Field(
        default=1, ge=1, description="Initialisations per scan; the one with the least MDL is kept."
    )
    unexplained_components: int = Field(
        default=16,
        ge=0,
        description="Components beside K_max that each scan of a coupled or shared fit may have where the other scan "
        "explains it worst, one for each place; 0: none.",
    )
    min_std: float | None = Field(
        default=None,
        gt=0,
        description="Least standard deviation of a component, m; null: 1e-4 of the scan's extent.",
    )
    covariance_floor: Literal["model", "paper"] = Field(
        default="model",
        description="What keeps components from collapsing: every point has a small spread of its own (model), or 1e-5 "
        "of the scan's mean variance is added in every M-step, as in Bouman's program (paper).",
    )
    precision: Literal["float64", "float32"] = Field(
        default="float64", description="Arithmetic of the EM iterations."
    )


@dataclass(frozen=True)
class FitPlan:
    """How one batch is fitted: the settings, K_max and the seed (each one for all, or one per pair).

    `reference` holds the mixtures of the reference scans where they are known already. `made`, a dictionary, lets
    several detectors share the fits they have in common; such a plan belongs to one batch.
    """

    settings: Fit
    max_components: int | Sequence[int] = 20
    seed: int | Sequence[int] = 0
    reference: FitResult | None = None
    made: dict[Hashable, Any] | None = field(default=None, compare=False, repr=False)

    def per_scan(self, sides: int) -> tuple[int | list[int], int | list[int]]:
        """K_max and seed for the scans of so many sides, one side after the other."""
        orders, seeds = self.max_components, self.seed
        return (
            orders if isinstance(orders, int) else [*orders] * sides,
            seeds if isinstance(seeds, int) else [*seeds] * sides,
        )

    def once(self, what: Hashable, fit: Callable[[], T]) -> T:
        """The fit of this name; where detectors share fits it is made when it is first asked for."""
        if self.made is None:
            return fit()
        if what not in self.made:
            self.made[what] = fit()
        return self.made[what]


@dataclass(frozen=True, eq=False)
class Models:
    """The mixtures of P pairs; row p of each belongs to pair p."""

    reference: FitResult
    current: FitResult

    def exchanged(self) -> Models:
        """The same mixtures with the roles exchanged."""
        return Models(reference=self.current, current=self.reference)

    def select(self, rows: Sequence[int], max_components: int) -> Models:
        """The mixtures of these pairs, which were fitted with this K_max, without the padding for others."""
        sides = (self.reference.select(rows), self.current.select(rows))
        reference, current = (
            replace(side, mixtures=side.mixtures.trim(), mdl_path=side.mdl_path[:, :max_components])
            for side in sides
        )
        return Models(reference=reference, current=current)


def fit_independently(batch: PreparedPairs, plan: FitPlan) -> Models:
    """Fit every scan on its own, as the paper does, all 2 P of them in one batch (Algorithm 1).

    Where the plan knows the mixtures of the references, only the current scans are fitted.
    """
    return plan.once("independent", lambda: _fit_independently(batch, plan))


def _fit_independently(batch: PreparedPairs, plan: FitPlan) -> Models:
    if plan.reference is not None:
        return Models(reference=plan.reference, current=fit_scans([batch.current], plan))
    fits = fit_scans([batch.reference, batch.current], plan)
    pairs = len(batch)
    return Models(reference=fits.select(range(pairs)), current=fits.select(range(pairs, 2 * pairs)))


def fit_scans(sides: Sequence[PreparedScans], plan: FitPlan, return_path: bool = False) -> FitResult:
    """Fit every scan of the sides, P each, on its own; the fits of the first side come first.

    Args:
        sides: The scans.
        plan: How to fit them.
        return_path: Keep the mixtures of all orders, not the best ones only.
    """
    max_components, seed = plan.per_scan(len(sides))
    return gmmtorch.fit_mdl(
        PointClouds.concatenate([fitted_clouds(scans, plan.settings) for scans in sides]),
        max_components=max_components,
        initializer=plan.settings.initializer,
        n_init=plan.settings.n_init,
        min_std=plan.settings.min_std,
        covariance_floor=plan.settings.covariance_floor,
        seed=seed,
        return_path=return_path,
    )


def fitted_clouds(scans: PreparedScans, settings: Fit) -> PointClouds:
    """The cells of every scan as the settings let the fit see them."""
    clouds = scans.cells if settings.moments == "spread" else scans.cells.centroids()
    return clouds.to(dtype=torch.float32 if settings.precision == "float32" else torch.float64)


def advice_of(status: Status) -> str:
    """What the engine advises, in terms of the configuration."""
    advice = status.advice
    for given, here in ADVICE.items():
        advice = advice.replace(given, here)
    return advice


__all__ = [
    "Fit",
    "FitPlan",
    "GaussianMixtures",
    "Models",
    "advice_of",
    "fit_independently",
    "fit_scans",
    "fitted_clouds",
]
