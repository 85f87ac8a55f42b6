"""Rigid motions that lay one thing over another: many starts at once, both things seen only in part."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

FIRST_REACH = 0.25
"""Partners may first be this part of the things' size apart; the reach then shrinks from step to step."""

SHRINK = 0.8


@dataclass(frozen=True, eq=False)
class Overlays:
    """S rigid motions of a thing of A points onto one of B points.

    Attributes:
        rotations: (S, 3, 3).
        shifts: (S, 3), m.
        gaps: (S, A), from each moved point to the nearest of the other thing, m.
        back_gaps: (S, B), from each point of the other thing to the nearest moved one, m.
    """

    rotations: Tensor
    shifts: Tensor
    gaps: Tensor
    back_gaps: Tensor

    def best(self, count: int, tolerance: float) -> Overlays:
        """The motions that lay most points of either thing within the tolerance."""
        close = (self.gaps < tolerance).double().mean(1) + (self.back_gaps < tolerance).double().mean(1)
        kept = close.topk(min(count, len(close))).indices
        return Overlays(self.rotations[kept], self.shifts[kept], self.gaps[kept], self.back_gaps[kept])


def overlay(
    source: Tensor, target: Tensor, rotations: Tensor, shifts: Tensor, reach: float, steps: int
) -> Overlays:
    """Iterative closest points in both directions at once, robust: partners beyond the reach have no say.

    Args:
        source: (A, 3) m.
        target: (B, 3) m.
        rotations: (S, 3, 3), the starts.
        shifts: (S, 3) m, the starts.
        reach: Least distance at which partners are given up, m.
        steps: Iterations.
    """
    size = float(torch.maximum(_size(source), _size(target)))
    for step in range(steps):
        limit = max(reach, size * FIRST_REACH * SHRINK**step)
        apart = _apart(source, target, rotations, shifts)  # (S, A, B)
        gaps, partners = apart.min(2)
        back_gaps, back_partners = apart.min(1)
        moving = torch.cat([source.expand(len(rotations), -1, -1), source[back_partners]], 1)
        fixed = torch.cat([target[partners], target.expand(len(rotations), -1, -1)], 1)
        rotations, shifts = _best_motion(moving, fixed, _weights(torch.cat([gaps, back_gaps], 1), limit))
    apart = _apart(source, target, rotations, shifts)
    return Overlays(rotations, shifts, apart.amin(2), apart.amin(1))


def _size(points: Tensor) -> Tensor:
    return (points.amax(0) - points.amin(0)).max()


def _apart(source: Tensor, target: Tensor, rotations: Tensor, shifts: Tensor) -> Tensor:
    moved = source @ rotations.mT + shifts[:, None]
    return torch.cdist(
        moved,
        target.expand(len(moved), -1, -1),
        compute_mode="donot_use_mm_for_euclid_dist",  # on a map a product loses centimetres
    )


def _weights(gaps: Tensor, limit: float) -> Tensor:
    """Geman-McClure weights, 0 beyond the limit, with sum 1 (S, A + B)."""
    weights = (1 + (2 * gaps / limit).square()).pow(-2) * (gaps < limit)
    weights = weights + torch.finfo(weights.dtype).eps
    return weights / weights.sum(1, keepdim=True)


def _best_motion(moving: Tensor, fixed: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """The rigid motions (S, 3, 3), (S, 3) with the least weighted squared distances (Kabsch 1976)."""
    weights = weights[..., None]
    middle, aim = (weights * moving).sum(1), (weights * fixed).sum(1)
    covariance = (weights * (moving - middle[:, None])).mT @ (fixed - aim[:, None])
    U, _, Vh = torch.linalg.svd(covariance)
    signs = torch.ones_like(middle)
    signs[:, 2] = torch.linalg.det(Vh.mT @ U.mT).sign()  # no mirror images
    rotations = (Vh.mT * signs[:, None]) @ U.mT
    return rotations, aim - (rotations @ middle[..., None]).squeeze(-1)
