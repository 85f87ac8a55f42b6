"""Small symmetric matrices, many at a time, without synchronising the device."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

__all__ = [
    "is_positive",
    "log_determinant",
    "num_lifted",
    "pack_symmetric",
    "precision_matrix",
    "safe_cholesky",
    "triangle",
    "unpack_symmetric",
]


def num_lifted(dim: int) -> int:
    """Return the number of lifted features F = 1 + D + D (D + 1) / 2: also the parameters of one component."""
    return 1 + dim + dim * (dim + 1) // 2


@lru_cache(maxsize=32)
def triangle(dim: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return rows a and columns b of the upper triangle a <= b, row by row."""
    pairs = [(a, b) for a in range(dim) for b in range(a, dim)]
    return tuple(a for a, _ in pairs), tuple(b for _, b in pairs)


def pack_symmetric(matrices: Tensor) -> Tensor:
    """Keep the upper triangle: (..., D, D) -> (..., D (D + 1) / 2)."""
    return matrices.flatten(-2).index_select(-1, _packing(matrices.shape[-1], matrices.device))


def unpack_symmetric(packed: Tensor, dim: int) -> Tensor:
    """Fill both triangles: (..., D (D + 1) / 2) -> (..., D, D)."""
    return packed.index_select(-1, _unpacking(dim, packed.device)).unflatten(-1, (dim, dim))


def safe_cholesky(matrices: Tensor) -> tuple[Tensor, Tensor]:
    """Lower Cholesky factors, and whether each matrix has one; does not synchronise.

    Args:
        matrices: symmetric matrices (..., D, D).

    Returns:
        The factors (..., D, D), the identity where there is none, and the mask (...) bool of those that have one.
    """
    factor, info = torch.linalg.cholesky_ex(matrices)
    positive = (info == 0) & torch.isfinite(factor).all(-1).all(-1)
    identity = torch.eye(matrices.shape[-1], dtype=matrices.dtype, device=matrices.device)
    return torch.where(positive[..., None, None], factor, identity), positive


def is_positive(matrices: Tensor) -> Tensor:
    """Whether symmetric matrices (..., D, D) are positive definite (...) bool; does not synchronise."""
    return torch.linalg.cholesky_ex(matrices).info == 0


def log_determinant(factor: Tensor) -> Tensor:
    """Log |S| from the Cholesky factor of S: (..., D, D) -> (...)."""
    return 2.0 * factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)


def precision_matrix(factor: Tensor) -> Tensor:
    """S^-1 from the Cholesky factor of S: (..., D, D) -> (..., D, D).

    Not by `torch.cholesky_inverse`, which waits for the device.
    """
    identity = torch.eye(factor.shape[-1], dtype=factor.dtype, device=factor.device)
    whitening = torch.linalg.solve_triangular(factor, identity.expand_as(factor), upper=False)
    return whitening.mT @ whitening


@lru_cache(maxsize=32)
def _packing(dim: int, device: torch.device) -> Tensor:
    """Where each entry of the packed triangle lies in the matrix, on the device once and for all."""
    return torch.tensor([a * dim + b for a, b in zip(*triangle(dim), strict=True)], device=device)


@lru_cache(maxsize=32)
def _unpacking(dim: int, device: torch.device) -> Tensor:
    """Where each entry of the matrix lies in the packed triangle."""
    place = {pair: i for i, pair in enumerate(zip(*triangle(dim), strict=True))}
    return torch.tensor([place[min(a, b), max(a, b)] for a in range(dim) for b in range(dim)], device=device)
