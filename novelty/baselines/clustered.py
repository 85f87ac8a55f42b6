"""Mixtures made of clusters: what memberships of points say of weights, means and covariances."""

from __future__ import annotations

import torch
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.linalg import pack_symmetric, unpack_symmetric

RELATIVE_FLOOR = 1e-4
"""Least standard deviation of a cluster, in units of the extent of its cloud: a numerical guard."""


def clustered_mixtures(
    clouds: PointClouds, memberships: Tensor, centre_power: float = 1.0
) -> GaussianMixtures:
    """P_k, V_k and F_k of clusters that points belong to by u_nk (Gath & Geva 1989, eqs. 3, 9 and 10).

    P_k = sum_n u_nk / N, V_k = sum_n u_nk^q x_n / sum_n u_nk^q, F_k = sum_n u_nk (x_n - V_k)(x_n - V_k)^T / sum_n u_nk.
    With memberships of 0 and 1 and q = 1 these are shares, means and covariances of the clusters.

    Args:
        clouds: B clouds near the origin, m; points count by their weight, cells add their spread to F_k.
        memberships: u_nk (N, K), in [0, 1].
        centre_power: q.

    Returns:
        B mixtures of K components each; an empty cluster has weight 0, mean 0 and the covariance of a single point.
    """
    mass, first, second = _moments(clouds, memberships)
    powered, first_powered, _ = (
        (mass, first, second) if centre_power == 1 else _moments(clouds, memberships**centre_power)
    )
    centres = first_powered / _positive(powered)[..., None]
    mean = first / _positive(mass)[..., None]
    outer = mean[..., :, None] * centres[..., None, :]
    covariances = (
        second / _positive(mass)[..., None, None]
        - outer
        - outer.mT
        + centres[..., :, None] * centres[..., None, :]
    )
    identity = torch.eye(clouds.dim, dtype=mass.dtype, device=mass.device)
    present = (mass > 0)[..., None, None]
    floored = torch.where(present, covariances, 0.0) + _floor(clouds)[:, None, None, None] * identity
    return GaussianMixtures(
        weights=mass / _positive(mass.sum(1, keepdim=True)),
        means=centres,
        covariances=floored,
        num_components=torch.full_like(mass[:, 0], mass.shape[1]).long(),
    )


def _moments(clouds: PointClouds, memberships: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Sums of w u, w u x and w u (x x^T + spread) over the points of every cloud: (B, K), (B, K, D), (B, K, D, D)."""
    x = clouds.points
    second = x[:, :, None] * x[:, None, :]
    if clouds.spreads is not None:
        second = second + clouds.spreads
    features = torch.cat([torch.ones_like(x[:, :1]), x, pack_symmetric(second)], 1)
    weighted = memberships * clouds.weights[:, None]
    pairs = zip(clouds.split(weighted), clouds.split(features), strict=True)
    sums = torch.stack([u.T @ phi for u, phi in pairs])  # (B, K, F)
    return (
        sums[..., 0],
        sums[..., 1 : 1 + clouds.dim],
        unpack_symmetric(sums[..., 1 + clouds.dim :], clouds.dim),
    )


def _floor(clouds: PointClouds) -> Tensor:
    """Variance of a single point (B,), m^2."""
    squared = clouds.points.square().sum(1) * clouds.weights
    extent = torch.stack([part.sum() for part in clouds.split(squared)]) / _positive(clouds.total_weights)
    return RELATIVE_FLOOR**2 * torch.where(extent > 0, extent, 1.0)


def _positive(values: Tensor) -> Tensor:
    return values.clamp_min(torch.finfo(values.dtype).tiny)
