"""Resize: which two components to join, and their union (eq. 7)."""

from __future__ import annotations

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.components import Components

__all__ = ["merge_by_tensor_operations", "merge_closest_pair", "merge_distances"]


def merge_distances(components: Components, total: Tensor) -> Tensor:
    """d(l, m) = N pi_l / 2 log(|S_lm| / |S_l|) + N pi_m / 2 log(|S_lm| / |S_m|) of all pairs l < m (eq. 7).

    Args:
        components: the mixtures.
        total: N, total weight of every cloud (B,).

    Returns:
        Distances (B, P) in the order of `torch.triu_indices`, nats; inf where a component is absent.
    """
    left, right = _pairs(components)
    _, _, covariances = _union(components, left, right)
    log_dets = linalg.log_determinant(components.factors)  # (B, K)
    union = linalg.log_determinant(linalg.safe_cholesky(covariances)[0])  # (B, P)
    mass = total[:, None] * components.weights
    distances = 0.5 * mass[:, left] * (union - log_dets[:, left]) + 0.5 * mass[:, right] * (
        union - log_dets[:, right]
    )
    return torch.where((mass[:, left] > 0) & (mass[:, right] > 0), distances, torch.inf)


def merge_closest_pair(components: Components, total: Tensor, clouds: Tensor) -> Components:
    """Replace the pair of least d(l, m) by its moment-matched union, in the first one's slot.

    Args:
        components: the mixtures, at least two slots.
        total: N (B,).
        clouds: which clouds to merge a pair of (B,) bool; the others stay as they are.
    """
    if components.weights.device.type == "cpu":
        from gmmtorch.compiled import merging  # 0.4 s: the import of Numba

        return merging.merge_closest_pair(components, total, clouds)
    return merge_by_tensor_operations(components, total, clouds)


def merge_by_tensor_operations(components: Components, total: Tensor, clouds: Tensor) -> Components:
    """What `merge_closest_pair` does, on any device."""
    left, right = _pairs(components)
    pair = merge_distances(components, total).argmin(1)  # (B,); the first of equals
    kept, dropped = left[pair], right[pair]
    slots = torch.arange(components.weights.shape[1], device=kept.device)
    weights, means, covariances = (v.squeeze(1) for v in _union(components, kept[:, None], dropped[:, None]))
    here = (slots == kept[:, None]) & clouds[:, None]  # (B, K)
    gone = (slots == dropped[:, None]) & clouds[:, None]
    merged = Components.create(
        torch.where(gone, 0.0, torch.where(here, weights[:, None], components.weights)),
        torch.where(here[..., None], means[:, None], components.means),
        torch.where(here[..., None, None], covariances[:, None], components.covariances),
    )
    return merged.where(clouds, components)


def _pairs(components: Components) -> tuple[Tensor, Tensor]:
    """Slots l < m of all pairs (P,), (P,)."""
    slots = components.weights.shape[1]
    left, right = torch.triu_indices(slots, slots, 1, device=components.weights.device)
    return left, right


def _union(components: Components, left: Tensor, right: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Moments of the union of pairs: slots (P,) or (B, P) -> weights (B, P), means (B, P, D), covariances."""
    batch = components.weights.shape[0]
    left, right = left.expand(batch, -1), right.expand(batch, -1)

    def at(values: Tensor, slots: Tensor) -> Tensor:
        return torch.take_along_dim(values, slots.reshape(slots.shape + (1,) * (values.ndim - 2)), 1)

    a, b = at(components.weights, left), at(components.weights, right)
    weights = a + b
    share = torch.where(weights > 0, b / torch.where(weights > 0, weights, 1.0), 0.5)[..., None]
    first, second = at(components.means, left), at(components.means, right)
    apart = second - first
    means = first + share * apart
    share = share[..., None]
    within = (1 - share) * at(components.covariances, left) + share * at(components.covariances, right)
    covariances = within + share * (1 - share) * apart[..., :, None] * apart[..., None, :]
    return weights, means, covariances
