"""The ground distance between components that earth mover's distances are made of."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

import gmmtorch.distances
from gmmtorch import GaussianMixtures

GroundDistanceName = Literal["hellinger", "mean", "bures", "combined"]
"""Pure numbers, except `mean` and `bures`, which are in metres."""

UNITS: dict[GroundDistanceName, str] = {"hellinger": "", "mean": " m", "bures": " m", "combined": ""}
"""What to print behind a distance."""


def ground_distances(
    name: GroundDistanceName, a: GaussianMixtures, b: GaussianMixtures, length_scale: float
) -> Tensor:
    """Distance between every component of the mixtures a and every one of b (P, K_a, K_b)."""
    if name == "hellinger":
        return hellinger_distance(a, b)
    return gmmtorch.distances.ground_distance(
        name, a.means, a.covariances, b.means, b.covariances, length_scale=length_scale
    )


def hellinger_distance(a: GaussianMixtures, b: GaussianMixtures) -> Tensor:
    """sqrt(1 - integral sqrt(p q)) between components, in [0, 1]: 0 the same, 1 no overlap (P, K_a, K_b).

    It takes place and shape together and has no unit, so one value means the same on a table and in a hall; and
    since it saturates, a component without counterpart costs the same however far the next one is.
    """
    mean_covariance = (a.covariances[:, :, None] + b.covariances[:, None, :]) / 2  # (P, K_a, K_b, 3, 3)
    factor = torch.linalg.cholesky_ex(mean_covariance).L
    difference = (a.means[:, :, None] - b.means[:, None, :])[..., None]
    whitened = torch.linalg.solve_triangular(factor, difference, upper=False).squeeze(-1)
    spread = (
        _log_determinant(factor)
        - (
            _log_determinant(torch.linalg.cholesky_ex(a.covariances).L)[:, :, None]
            + _log_determinant(torch.linalg.cholesky_ex(b.covariances).L)[:, None, :]
        )
        / 2
    )
    bhattacharyya = whitened.square().sum(-1) / 8 + spread / 2
    return (-torch.expm1(-bhattacharyya.clamp_min(0))).sqrt()


def _log_determinant(factor: Tensor) -> Tensor:
    """Log det(L L^T)."""
    return 2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
