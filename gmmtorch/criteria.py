"""Criteria that choose the model order: a description length in nats, smaller is better."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.errors import ArgumentError

__all__ = ["CRITERIA", "Criterion", "criterion_named", "merge_saving"]

Criterion = Callable[[Tensor, Tensor, Tensor, int], Tensor]
"""(log-likelihood (B,), weights (B, K), total weight N (B,), D) -> description length (B,), nats."""


def mdl(log_likelihood: Tensor, weights: Tensor, total: Tensor, dim: int) -> Tensor:
    """MDL = -log p + L / 2 log(N D), L = K (1 + D + D (D + 1) / 2) - 1 (eq. 6; Rissanen 1983, Bouman 1997)."""
    return 0.5 * _num_parameters(weights, dim) * (total * dim).log() - log_likelihood


def bic(log_likelihood: Tensor, weights: Tensor, total: Tensor, dim: int) -> Tensor:
    """BIC / 2 = -log p + L / 2 log N (Schwarz 1978)."""
    return 0.5 * _num_parameters(weights, dim) * total.log() - log_likelihood


def mml(log_likelihood: Tensor, weights: Tensor, total: Tensor, dim: int) -> Tensor:
    """Minimum message length of a mixture (Figueiredo & Jain 2002, eq. 15), M = D + D (D + 1) / 2.

    M / 2 sum_k log(N pi_k / 12) + K / 2 log(N / 12) + K (M + 1) / 2 - log p.
    """
    present = weights > 0
    order = present.sum(-1)
    per_component = linalg.num_lifted(dim) - 1
    shares = torch.where(present, total[:, None] * weights / 12.0, 1.0).log().sum(-1)
    fixed = 0.5 * order * (total / 12.0).log() + 0.5 * order * (per_component + 1)
    return 0.5 * per_component * shares + fixed - log_likelihood


CRITERIA: dict[str, Criterion] = {"mdl": mdl, "bic": bic, "mml": mml}


def criterion_named(name: str) -> Criterion:
    """Look a criterion up.

    Raises:
        ArgumentError: if there is none of that name.
    """
    if name not in CRITERIA:
        raise ArgumentError(f"unknown criterion {name!r}; choose one of {', '.join(sorted(CRITERIA))}")
    return CRITERIA[name]


def merge_saving(total: Tensor, dim: int) -> Tensor:
    """What one component less saves in eq. 6: (1 + D + D (D + 1) / 2) / 2 log(N D) (B,), nats."""
    return 0.5 * linalg.num_lifted(dim) * (total * dim).log()


def _num_parameters(weights: Tensor, dim: int) -> Tensor:
    """L = K (1 + D + D (D + 1) / 2) - 1 (B,)."""
    return (weights > 0).sum(-1) * linalg.num_lifted(dim) - 1
