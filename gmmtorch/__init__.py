"""Batched Gaussian mixtures for point clouds: EM, and the model order by minimum description length."""

from gmmtorch.clouds import PointClouds
from gmmtorch.criteria import CRITERIA
from gmmtorch.em import EMResult, fit_em
from gmmtorch.errors import ArgumentError, GmmError, SerializationError, ShapeError, Status
from gmmtorch.initializers import INITIALIZERS
from gmmtorch.mixtures import GaussianMixtures
from gmmtorch.reduction import FitResult, description_length, fit_mdl

__all__ = [
    "CRITERIA",
    "INITIALIZERS",
    "ArgumentError",
    "EMResult",
    "FitResult",
    "GaussianMixtures",
    "GmmError",
    "PointClouds",
    "SerializationError",
    "ShapeError",
    "Status",
    "description_length",
    "fit_em",
    "fit_mdl",
]
