"""A mixture together with what it stands for: all that has to be stored to refine it with later scans."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from os import PathLike

import torch
from torch import Tensor

from gmmtorch import serialization
from gmmtorch.clouds import ArrayLike, PointClouds
from gmmtorch.errors import ArgumentError, SerializationError, ShapeError
from gmmtorch.mixtures import GaussianMixtures
from gmmtorch.summary import summarize

__all__ = ["NUM_CELLS", "MixtureModel"]

NUM_CELLS = 256  # about 40 kB per mixture of points in space
_FORMAT = "gmmtorch.MixtureModel"


@dataclass(frozen=True, eq=False)
class MixtureModel:
    """B mixtures, and the sufficient statistics of the points that they describe.

    Attributes:
        mixtures: the mixtures.
        cells: B clouds of cells: number, mean and covariance of the points in small patches. No cells where there is
            no mixture.

    Example:
        >>> from gmmtorch import fit_mdl
        >>> clouds = PointClouds.from_list([torch.randn(5000, 3, generator=torch.Generator().manual_seed(0))])
        >>> model = MixtureModel.of(fit_mdl(clouds).mixtures, clouds)
        >>> model.total_weights.tolist(), len(model.cells.points) < 600
        ([5000.0], True)
    """

    mixtures: GaussianMixtures
    cells: PointClouds

    @staticmethod
    def of(mixtures: GaussianMixtures, clouds: PointClouds, num_cells: int = NUM_CELLS) -> MixtureModel:
        """Model of mixtures that were fitted to these clouds.

        Args:
            mixtures: the mixtures; a cloud whose mixture is empty leaves nothing.
            clouds: what they describe, one cloud per mixture.
            num_cells: about how many cells to keep of every cloud; no cell mixes components.

        Raises:
            ShapeError: if there is not one mixture per cloud.
        """
        described = (mixtures.num_components > 0)[clouds.cloud_index]
        components = torch.where(described, mixtures.assign(clouds), -1)
        return MixtureModel(mixtures, summarize(clouds, num_cells, components))

    @staticmethod
    def from_weights(mixtures: GaussianMixtures, total_weights: ArrayLike) -> MixtureModel:
        """Model of mixtures of which nothing else is left: every component becomes one cell.

        An update can move, widen or merge such components, but not divide them any more.

        Args:
            mixtures: the mixtures.
            total_weights: number of points that each stands for (B,), > 0 unless the mixture is empty.

        Raises:
            ShapeError: if there is not one total weight per mixture.
            ArgumentError: if a total weight is not finite and > 0.
        """
        total = torch.as_tensor(total_weights).detach().to(mixtures.weights)
        if total.shape != (mixtures.batch_size,):
            raise ShapeError(
                f"expected {mixtures.batch_size} total weights, one per mixture, got {tuple(total.shape)}"
            )
        if not bool(((total.isfinite() & (total > 0)) | (mixtures.num_components == 0)).all()):
            raise ArgumentError(
                "total_weights must be > 0: give the number of points that each mixture stands for"
            )
        present = mixtures.mask
        cells = PointClouds(
            points=mixtures.means[present],
            weights=(total[:, None] * mixtures.weights)[present],
            spreads=mixtures.covariances[present],
            offsets=(0, *accumulate(mixtures.num_components.tolist())),
        )
        return MixtureModel(mixtures, cells)

    @property
    def batch_size(self) -> int:
        """Number of mixtures B."""
        return self.mixtures.batch_size

    @property
    def total_weights(self) -> Tensor:
        """Number of points that each mixture stands for (B,) float64."""
        return self.cells.total_weights

    def save(self, path: str | PathLike[str]) -> None:
        """Write a safetensors file."""
        mixtures, cells = self.mixtures, self.cells
        assert cells.spreads is not None
        tensors = {
            "weights": mixtures.weights,
            "means": mixtures.means,
            "covariances": mixtures.covariances,
            "num_components": mixtures.num_components,
            "cell_weights": cells.weights,
            "cell_means": cells.points,
            "cell_spreads": cells.spreads,
            "cell_counts": torch.tensor(cells.sizes),
        }
        serialization.save(path, _FORMAT, tensors)

    @staticmethod
    def load(path: str | PathLike[str]) -> MixtureModel:
        """Read a file that `save` wrote.

        Raises:
            SerializationError: if the file is missing, damaged, or of another kind.
        """
        tensors = serialization.load(path, _FORMAT)
        names = ("weights", "means", "covariances", "num_components")
        try:
            sizes = tensors["cell_counts"].tolist()
            parts = [tensors[name].split(sizes) for name in ("cell_means", "cell_weights", "cell_spreads")]
            cells = PointClouds.from_list(*parts)
            return MixtureModel(GaussianMixtures.from_arrays(*(tensors[name] for name in names)), cells)
        except (KeyError, RuntimeError, ArgumentError, ShapeError) as error:
            raise SerializationError(f"{path} does not hold a valid model: {error}") from error
