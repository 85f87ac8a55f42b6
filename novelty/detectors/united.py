"""One mixture for both scans of a pair, and components for what only one of them shows.

MDL gives K_max components to what both scans show. Where one scan explains the other worst, the other gets components
of its own beside these, so that a thing that is new or gone never has to be found inside a component of a wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

import gmmtorch
from gmmtorch import FitResult, PointClouds
from novelty.detectors.unexplained import Unexplained, find_unexplained
from novelty.fitting import FitPlan, fitted_clouds
from novelty.preprocess.prepared import PreparedPairs


@dataclass(frozen=True, eq=False)
class UnitedFit:
    """The common mixtures of P pairs and what they leave to each scan.

    Attributes:
        fit: one mixture per pair, fitted to the cells that both scans explain.
        explained: points (cells, where `moments` is centroid) of the references and of the current scans behind that
            fit, (P,) each.
        reference: what the current scans do not explain of the references.
        current: what the references do not explain of the current scans.
    """

    fit: FitResult
    explained: tuple[torch.Tensor, torch.Tensor]
    reference: Unexplained
    current: Unexplained


def fit_united(batch: PreparedPairs, plan: FitPlan) -> UnitedFit:
    """Fit one mixture to both scans of every pair together, its order chosen by MDL; P fits."""
    return plan.once("united", lambda: _fit_united(batch, plan))


def _fit_united(batch: PreparedPairs, plan: FitPlan) -> UnitedFit:
    settings = plan.settings
    clouds = fitted_clouds(batch.reference, settings), fitted_clouds(batch.current, settings)
    found = find_unexplained(batch, clouds, settings.unexplained_components)
    sides = [unexplained.explained(fitted) for unexplained, fitted in zip(found, clouds, strict=True)]
    fit = gmmtorch.fit_mdl(
        unite(*sides),
        max_components=plan.max_components,
        initializer=settings.initializer,
        n_init=settings.n_init,
        min_std=settings.min_std,
        covariance_floor=settings.covariance_floor,
        seed=plan.seed,
    )
    return UnitedFit(fit, (sides[0].total_weights, sides[1].total_weights), *found)


def unite(reference: PointClouds, current: PointClouds) -> PointClouds:
    """Both scans of every pair as one cloud, the reference's points first: P clouds."""
    pairs = len(reference)
    order = [row for pair in range(pairs) for row in (pair, pair + pairs)]
    both = PointClouds.concatenate([reference, current]).select(order)
    return PointClouds(both.points, both.weights, both.spreads, both.offsets[::2], both.dtype)
