"""Coupled fits: both scans of a pair are cut into the same components wherever both show the same surface.

Two independent fits cut one wall in two different ways, and a comparison of components then finds differences
where nothing changed. Here one mixture is fitted to both scans together, its order chosen by MDL, and serves
each scan as the start of a few EM iterations of its own.
"""

from __future__ import annotations

import torch

import gmmtorch
from gmmtorch import FitResult, GaussianMixtures, PointClouds
from novelty.detectors.moments import mixtures_of, moments_of
from novelty.detectors.united import fit_united
from novelty.fitting import Fit, FitPlan, Models, fitted_clouds
from novelty.preprocess.prepared import PreparedPairs


def fit_coupled(batch: PreparedPairs, plan: FitPlan, max_iterations: int) -> Models:
    """Fit one mixture to both scans of every pair, then let each scan refine it.

    Args:
        batch: P pairs.
        plan: Settings of the common fit; K_max holds for both scans together.
        max_iterations: EM iterations that each scan makes from the common mixture.
    """
    return plan.once(("coupled", max_iterations), lambda: _fit_coupled(batch, plan, max_iterations))


def _fit_coupled(batch: PreparedPairs, plan: FitPlan, max_iterations: int) -> Models:
    settings = plan.settings
    reference, current = (fitted_clouds(scans, settings) for scans in (batch.reference, batch.current))
    united = fit_united(batch, plan)
    starts = [
        mixtures_of(moments_of(united.fit.mixtures, points), unexplained.groups)
        for points, unexplained in zip(united.explained, (united.reference, united.current), strict=True)
    ]
    return Models(
        reference=_refined(reference, starts[0], settings, max_iterations),
        current=_refined(current, starts[1], settings, max_iterations),
    )


def _refined(clouds: PointClouds, initial: GaussianMixtures, settings: Fit, max_iterations: int) -> FitResult:
    """EM of each cloud from the mixture of its pair; a component that finds no points is dropped."""
    fit = gmmtorch.fit_em(
        clouds,
        initial=initial,
        min_std=settings.min_std,
        covariance_floor=settings.covariance_floor,
        max_iterations=max_iterations,
        tolerance=None,  # so many steps, and no question of convergence
    )
    orders = torch.arange(1, initial.num_slots + 1, device=fit.mixtures.weights.device)
    mdl = gmmtorch.description_length(fit.mixtures, clouds)
    reached = orders == fit.mixtures.num_components[:, None]
    return FitResult(
        mixtures=fit.mixtures,
        mdl=mdl,
        mdl_path=torch.where(reached, mdl[:, None], torch.nan),
        log_likelihood=fit.log_likelihood,
        status=fit.status,
        num_iterations=fit.num_iterations,
    )
