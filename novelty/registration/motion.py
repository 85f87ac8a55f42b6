"""Small rigid motions of a batch of scans: R x + t, one per pair."""

from __future__ import annotations

from dataclasses import dataclass

import torch


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
        skew = self.rotations - self.rotations.transpose(1, 2)
        sine = 0.5 * torch.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], dim=-1).norm(dim=-1)
        cosine = 0.5 * (self.rotations.diagonal(dim1=1, dim2=2).sum(-1) - 1)
        return torch.rad2deg(torch.atan2(sine, cosine))


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
