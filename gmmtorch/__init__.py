"""Batched Gaussian mixtures for point clouds: EM, and the model order by minimum description length."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gmmtorch.clouds import PointClouds
from gmmtorch.coarsening import coarsen
from gmmtorch.criteria import CRITERIA
from gmmtorch.distances import (
    GROUND_DISTANCES,
    bures_distance,
    combined_distance,
    covariance_distance,
    ground_distance,
    hellinger_distance,
    mean_distance,
    symmetric_kl,
)
from gmmtorch.em import EMResult, fit_em
from gmmtorch.errors import ArgumentError, GmmError, SerializationError, ShapeError, Status
from gmmtorch.evaluation import Posterior
from gmmtorch.incremental import UpdateResult, update
from gmmtorch.initializers import INITIALIZERS
from gmmtorch.mixture_model import MixtureModel
from gmmtorch.mixtures import GaussianMixtures
from gmmtorch.reduction import FitResult, description_length, fit_mdl
from gmmtorch.removals import Removals, greedy_removals
from gmmtorch.summary import summarize
from gmmtorch.transport import Transport, TransportStatus, UnbalancedTransport, emd, unbalanced_emd

if TYPE_CHECKING:
    from gmmtorch.estimator import MDLGaussianMixture

__all__ = [
    "CRITERIA",
    "GROUND_DISTANCES",
    "INITIALIZERS",
    "ArgumentError",
    "EMResult",
    "FitResult",
    "GaussianMixtures",
    "GmmError",
    "MDLGaussianMixture",
    "MixtureModel",
    "PointClouds",
    "Posterior",
    "Removals",
    "SerializationError",
    "ShapeError",
    "Status",
    "Transport",
    "TransportStatus",
    "UnbalancedTransport",
    "UpdateResult",
    "bures_distance",
    "coarsen",
    "combined_distance",
    "covariance_distance",
    "description_length",
    "emd",
    "fit_em",
    "fit_mdl",
    "greedy_removals",
    "ground_distance",
    "hellinger_distance",
    "mean_distance",
    "summarize",
    "symmetric_kl",
    "unbalanced_emd",
    "update",
]


def __getattr__(name: str) -> Any:
    if name == "MDLGaussianMixture":  # on first use: scikit-learn takes as long to import as everything else
        from gmmtorch.estimator import MDLGaussianMixture

        globals()[name] = MDLGaussianMixture
        return MDLGaussianMixture
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
