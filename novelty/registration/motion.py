"""Small rigid motions of a batch of scans: R x + t, one per pair."""

from __future__ import annotations

from dataclasses import dataclass

import torch

SHORTEST = 1e-3
"""Least lever of a turn as a share of the longest: points on a line have none about it."""


@dataclass(frozen=True, eq=False)
class Motions:
    """P rigid motions: rotations (P, 3, 3) and translations (P, 3), m."""

    rotations: torch.Tensor
    translations: torch.Tensor

    @classmethod
    def identity(cls, pairs: int) -> Motions:
        """P motions that move nothing."""
        eye = torch.eye(3, dtype=torch.float64)
        return cls(eye.repeat(pairs, 1, 1), torch.zeros(pairs, 3, dtype=torch.float64))

    @classmethod
    def from_matrices(cls, matrices: torch.Tensor) -> Motions:
        """From (P, 4, 4)."""
        return cls(matrices[:, :3, :3], matrices[:, :3, 3])

    def matrices(self) -> torch.Tensor:
        """As (P, 4, 4)."""
        result = torch.eye(4, dtype=torch.float64).repeat(len(self.translations), 1, 1)
        result[:, :3, :3], result[:, :3, 3] = self.rotations, self.translations
        return result

    def apply(self, points: torch.Tensor, owner: torch.Tensor) -> torch.Tensor:
        """Move packed points (N, 3) of pairs `owner` (N,)."""
        return (self.rotations[owner] @ points[:, :, None])[:, :, 0] + self.translations[owner]

    def turn(self, shapes: torch.Tensor, owner: torch.Tensor) -> torch.Tensor:
        """R A R^T of packed covariances (N, 3, 3)."""
        rotations = self.rotations[owner]
        return rotations @ shapes @ rotations.transpose(1, 2)

    def then(self, steps: torch.Tensor) -> Motions:
        """These motions followed by exp of `steps` (P, 6): rotation vector (rad), translation (m)."""
        rotation = rotations_of(steps[:, :3])
        moved = _product(rotation, self.translations[:, :, None])[:, :, 0] + steps[:, 3:]
        return Motions(_product(rotation, self.rotations), moved)

    def about(self, centres: torch.Tensor) -> Motions:
        """The same motions of coordinates whose origin is not at `centres` (P, 3)."""
        turned = _product(self.rotations, centres[:, :, None])[:, :, 0]
        return Motions(self.rotations, centres + self.translations - turned)

    def where(self, condition: torch.Tensor, other: Motions) -> Motions:
        """These where `condition` (P,), the others elsewhere."""
        return Motions(
            torch.where(condition[:, None, None], self.rotations, other.rotations),
            torch.where(condition[:, None], self.translations, other.translations),
        )

    def angles(self) -> torch.Tensor:
        """Rotation angles, degrees (P,); accurate near 0, where the trace is not."""
        return torch.rad2deg(self._turns()[1])

    def steps(self) -> torch.Tensor:
        """The steps (P, 6) by which `then` makes these motions from none; for turns of less than 180 degrees."""
        scaled_axis, angle = self._turns()
        sine = scaled_axis.norm(dim=-1)
        stretch = torch.where(sine > 0, angle / sine.clamp_min(torch.finfo(sine.dtype).tiny), 1)
        return torch.cat([scaled_axis * stretch[:, None], self.translations], dim=-1)

    def _turns(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Axes of the rotations times the sine of their angles (P, 3), and the angles, rad (P,)."""
        skew = self.rotations - self.rotations.transpose(1, 2)
        scaled_axis = 0.5 * torch.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], dim=-1)
        cosine = 0.5 * (self.rotations.diagonal(dim1=1, dim2=2).sum(-1) - 1)
        return scaled_axis, torch.atan2(scaled_axis.norm(dim=-1), cosine)


@dataclass(frozen=True, eq=False)
class Levers:
    """How far turns carry the points of P scans, so that turns and shifts are measured alike, in metres.

    With L = (mean of |p|^2 I - p p^T)^(1/2), a small rotation vector w moves the points p by |L w| (root mean
    square): a long corridor is turned about its axis on a short lever, and about the others on a long one.

    Attributes:
        lengths: L (P, 3, 3), m.
        inverses: L^-1 (P, 3, 3), 1/m.
    """

    lengths: torch.Tensor
    inverses: torch.Tensor

    @classmethod
    def of(cls, points: torch.Tensor, owner: torch.Tensor, pairs: int) -> Levers:
        """Of packed points (N, 3) of pairs `owner` (N,), about the origin; a short one where they lie on an axis."""
        cross = cross_matrices(points)
        sums = points.new_zeros(pairs, 3, 3).index_add_(0, owner, cross.transpose(1, 2) @ cross)
        counts = torch.bincount(owner, minlength=pairs).clamp_min(1)
        squares, axes = torch.linalg.eigh(sums / counts[:, None, None])
        lengths = squares.clamp_min(SHORTEST**2 * squares[:, 2:]).sqrt().clamp_min(1e-12)
        turned = axes.transpose(1, 2)
        return cls(_product(axes * lengths[:, None], turned), _product(axes / lengths[:, None], turned))

    def displacements(self, steps: torch.Tensor) -> torch.Tensor:
        """Displacements (P, 6), m, of rotation vectors (rad) and translations (m), (P, 6)."""
        return torch.cat([_product(self.lengths, steps[:, :3, None])[:, :, 0], steps[:, 3:]], dim=-1)

    def steps(self, displacements: torch.Tensor) -> torch.Tensor:
        """The inverse of `displacements`."""
        turns = _product(self.inverses, displacements[:, :3, None])[:, :, 0]
        return torch.cat([turns, displacements[:, 3:]], dim=-1)


def rotations_of(vectors: torch.Tensor) -> torch.Tensor:
    """Exp [v]x of rotation vectors (P, 3), rad, by Rodrigues' formula, (P, 3, 3)."""
    angle = vectors.square().sum(-1).sqrt()[:, None, None]
    cross = cross_matrices(vectors)
    half = torch.sinc(0.5 * angle / torch.pi)
    identity = torch.eye(3, dtype=vectors.dtype)
    return identity + torch.sinc(angle / torch.pi) * cross + 0.5 * half.square() * _product(cross, cross)


def _product(left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
    """Product of P small matrices, each rounded as it would be alone: the BLAS does not promise that."""
    return (left[:, :, :, None] * right[:, None, :, :]).sum(2)


def cross_matrices(vectors: torch.Tensor) -> torch.Tensor:
    """[v]x with [v]x u = v x u, (N, 3, 3), of vectors (N, 3)."""
    x, y, z = vectors.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).reshape(-1, 3, 3)
