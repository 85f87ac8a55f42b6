"""A mixture together with how much it stands for: what has to be stored to refine it later."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike

import torch
from torch import Tensor

from gmmtorch import serialization
from gmmtorch.clouds import ArrayLike, PointClouds
from gmmtorch.errors import ArgumentError, SerializationError, ShapeError
from gmmtorch.mixtures import GaussianMixtures

__all__ = ["MixtureModel"]

_FORMAT = "gmmtorch.MixtureModel"


@dataclass(frozen=True, eq=False)
class MixtureModel:
    """B mixtures and the number of points that each stands for.

    Attributes:
        mixtures: the mixtures.
        total_weights: N, the total weight of the points that each mixture describes (B,) float64; 0 for an empty one.

    Example:
        >>> from gmmtorch import PointClouds, fit_mdl
        >>> clouds = PointClouds.from_list([torch.randn(500, 3, generator=torch.Generator().manual_seed(0))])
        >>> MixtureModel.of(fit_mdl(clouds).mixtures, clouds).total_weights
        tensor([500.], dtype=torch.float64)
    """

    mixtures: GaussianMixtures
    total_weights: Tensor

    @staticmethod
    def create(mixtures: GaussianMixtures, total_weights: ArrayLike) -> MixtureModel:
        """Build and check a model.

        Args:
            mixtures: the mixtures.
            total_weights: number of points that each stands for (B,), > 0 unless the mixture is empty.

        Raises:
            ShapeError: if there is not one total weight per mixture.
            ArgumentError: if a total weight is negative, not finite, or 0 beside a mixture.
        """
        total = torch.as_tensor(total_weights).detach().to(mixtures.weights)
        if total.shape != (mixtures.batch_size,):
            raise ShapeError(
                f"expected total_weights of shape ({mixtures.batch_size},), one per mixture, got {tuple(total.shape)}"
            )
        present = mixtures.num_components > 0
        if not bool((total.isfinite() & torch.where(present, total > 0, total >= 0)).all()):
            raise ArgumentError(
                "total_weights must be finite and > 0: give the number of points that each mixture stands for"
            )
        return MixtureModel(mixtures, torch.where(present, total, 0.0))

    @staticmethod
    def of(mixtures: GaussianMixtures, clouds: PointClouds) -> MixtureModel:
        """Model of mixtures that were fitted to these clouds.

        Raises:
            ShapeError: if there is not one mixture per cloud.
        """
        return MixtureModel.create(mixtures, clouds.total_weights.nan_to_num(0.0))

    @property
    def batch_size(self) -> int:
        """Number of mixtures B."""
        return self.mixtures.batch_size

    def save(self, path: str | PathLike[str]) -> None:
        """Write a safetensors file."""
        mixtures = self.mixtures
        serialization.save(
            path,
            _FORMAT,
            {
                "weights": mixtures.weights,
                "means": mixtures.means,
                "covariances": mixtures.covariances,
                "num_components": mixtures.num_components,
                "total_weights": self.total_weights,
            },
        )

    @staticmethod
    def load(path: str | PathLike[str]) -> MixtureModel:
        """Read a file that `save` wrote.

        Raises:
            SerializationError: if the file is missing, damaged, or of another kind.
        """
        tensors = serialization.load(path, _FORMAT)
        try:
            total = tensors.pop("total_weights")
            return MixtureModel.create(GaussianMixtures.from_arrays(**tensors), total)
        except (KeyError, TypeError, ArgumentError, ShapeError) as error:
            raise SerializationError(f"{path} does not hold a valid model: {error}") from error
