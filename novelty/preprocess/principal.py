"""Principal axis and surface variation of many 3x3 covariances at once, without an iterative eigensolver."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

RELATIVE_GAP = 1e-3
"""Below this gap between the two greatest eigenvalues, relative to the trace, `torch.linalg.eigh` takes over."""


@dataclass(frozen=True, eq=False)
class PrincipalAxes:
    """Of S clusters.

    Attributes:
        direction: Unit eigenvector of the greatest eigenvalue, (3, S); its greatest entry is positive.
        variance: The greatest eigenvalue lambda_2, (S,).
        surface_variation: sigma of eq. 1, (S,), in [0, 1/3]; 0 where all eigenvalues are 0.
    """

    direction: torch.Tensor
    variance: torch.Tensor
    surface_variation: torch.Tensor


def principal_axes(covariances: torch.Tensor) -> PrincipalAxes:
    """Principal axes of covariances given by their entries xx, xy, xz, yy, yz, zz, (6, S).

    The eigenvalues are the roots of the characteristic polynomial in trigonometric form, the direction is the
    longest cross product of two rows of A - lambda_2 I. Both are accurate while lambda_2 is a single root;
    nearly round clusters go through `torch.linalg.eigh`. Reads one number back from the device.
    """
    trace = covariances[0] + covariances[3] + covariances[5]  # (S,)
    shape = covariances / torch.where(trace > 0, trace, 1)  # (6, S), trace 1
    least, middle, greatest = _eigenvalues(shape)
    direction = _direction(shape, greatest)  # (3, S)
    round_ = torch.nonzero((greatest - middle < RELATIVE_GAP) & (trace > 0))[:, 0]
    if len(round_):
        exact = torch.linalg.eigh(_matrices(shape[:, round_]))
        direction[:, round_] = exact.eigenvectors[:, :, 2].T
        least[round_], greatest[round_] = exact.eigenvalues[:, 0], exact.eigenvalues[:, 2]
    return PrincipalAxes(
        direction=_oriented(direction),
        variance=greatest * trace,
        surface_variation=torch.where(trace > 0, least.clamp_min(0), 0),
    )


def _eigenvalues(shape: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Roots of det(A - lambda I) for trace 1, ascending, each (S,)."""
    xx, xy, xz, yy, yz, zz = shape
    xx, yy, zz = xx - 1 / 3, yy - 1 / 3, zz - 1 / 3
    radius = torch.sqrt((xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    cosine = determinant / (2 * radius**3).clamp_min(torch.finfo(shape.dtype).tiny)
    angle = torch.acos(cosine.clamp(-1, 1)) / 3
    greatest = 1 / 3 + 2 * radius * torch.cos(angle)
    least = 1 / 3 + 2 * radius * torch.cos(angle + 2 * math.pi / 3)
    return least, 1 - greatest - least, greatest


def _direction(shape: torch.Tensor, greatest: torch.Tensor) -> torch.Tensor:
    """Null vector of A - lambda_2 I, (3, S)."""
    xx, xy, xz, yy, yz, zz = shape
    xx, yy, zz = xx - greatest, yy - greatest, zz - greatest
    rows = (torch.stack([xx, xy, xz]), torch.stack([xy, yy, yz]), torch.stack([xz, yz, zz]))
    best = torch.linalg.cross(rows[0], rows[1], dim=0)
    length = (best * best).sum(0)
    for first, second in ((0, 2), (1, 2)):
        other = torch.linalg.cross(rows[first], rows[second], dim=0)
        other_length = (other * other).sum(0)
        best = torch.where(other_length > length, other, best)
        length = torch.maximum(other_length, length)
    return best / torch.sqrt(length).clamp_min(torch.finfo(shape.dtype).tiny)


def _oriented(direction: torch.Tensor) -> torch.Tensor:
    """The same axes with their entry of greatest magnitude positive."""
    largest = direction.abs().argmax(0, keepdim=True)
    return direction * torch.where(direction.gather(0, largest) < 0, -1.0, 1.0)


def _matrices(entries: torch.Tensor) -> torch.Tensor:
    """(6, S) -> (S, 3, 3)."""
    return entries[[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3)
