"""The parameters EM works on: a mixture per cloud, in the cloud's normalised coordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from gmmtorch import linalg

__all__ = ["ABSENT", "Components"]

ABSENT = -1e30  # the log-weight of a component that is not there: finite, so that 0 * ABSENT is 0


@dataclass(frozen=True)
class Components:
    """Weights, means and covariances of B mixtures; a component of weight 0 is absent, wherever it stands.

    Attributes:
        weights: pi_k (B, K) float64.
        means: mu_k (B, K, D) float64, 0 where absent.
        covariances: S_k (B, K, D, D) float64, the identity where absent.
        factors: lower Cholesky factors of the covariances (B, K, D, D) float64.
    """

    weights: Tensor
    means: Tensor
    covariances: Tensor
    factors: Tensor

    @staticmethod
    def create(weights: Tensor, means: Tensor, covariances: Tensor) -> Components:
        """Build from arrays of those shapes; neutralises absent components and those without a density."""
        factors, positive = linalg.safe_cholesky(covariances)
        weights = torch.where(positive, weights, 0.0)
        present = (weights > 0)[..., None]
        identity = torch.eye(means.shape[-1], dtype=means.dtype, device=means.device)
        # One after the other: `sum` adds in the lanes of the processor, and a slot more would change the last bit.
        total = weights.cumsum(-1)[..., -1:] if weights.shape[-1] else weights
        return Components(
            weights=weights / total.clamp_min(torch.finfo(weights.dtype).tiny),
            means=torch.where(present, means, 0.0),
            covariances=torch.where(present[..., None], covariances, identity),
            factors=torch.where(present[..., None], factors, identity),
        )

    @staticmethod
    def concatenate(parts: Sequence[Components]) -> Components:
        """Join batches of the same shape along B."""
        return Components(
            *(torch.cat(tensors) for tensors in zip(*(p._tensors() for p in parts), strict=True))
        )

    @property
    def num_components(self) -> Tensor:
        """Components present in every mixture (B,) int64."""
        return (self.weights > 0).sum(-1)

    @property
    def log_weights(self) -> Tensor:
        """Log pi_k, ABSENT where there is no component (B, K), nats."""
        return torch.where(self.weights > 0, self.weights, 1.0).log() + (self.weights <= 0) * ABSENT

    @property
    def log_scales(self) -> Tensor:
        """Log of each component's weight times its density at its mean (B, K), nats."""
        log_volume = self.means.shape[-1] * math.log(2.0 * math.pi) + linalg.log_determinant(self.factors)
        return self.log_weights - 0.5 * log_volume

    @property
    def precisions(self) -> Tensor:
        """S_k^-1 (B, K, D, D)."""
        return linalg.precision_matrix(self.factors)

    def take(self, clouds: Tensor) -> Components:
        """Mixtures of these clouds (B',) int64."""
        return Components(*(t.index_select(0, clouds) for t in self._tensors()))

    def put(self, clouds: Tensor, other: Components) -> Components:
        """Replace the mixtures of these clouds (B',) int64 by those of `other`."""
        pairs = zip(self._tensors(), other._tensors(), strict=True)
        return Components(*(mine.index_copy(0, clouds, theirs) for mine, theirs in pairs))

    def where(self, condition: Tensor, other: Components) -> Components:
        """Keep these where the condition (B,) or (B, K) bool holds, those of `other` elsewhere."""
        pairs = zip(self._tensors(), other._tensors(), strict=True)
        return Components(*(torch.where(_expand(condition, a), a, b) for a, b in pairs))

    def compact(self, num_slots: int) -> Components:
        """Move the components present to the front, in order, and keep `num_slots` slots."""
        order = torch.argsort((self.weights <= 0).to(torch.int8), dim=-1, stable=True)[:, :num_slots]
        return Components(*(torch.take_along_dim(t, _expand(order, t), dim=1) for t in self._tensors()))

    def pad(self, num_slots: int) -> Components:
        """Lengthen the component axis to `num_slots` with absent components."""
        extra = num_slots - self.weights.shape[1]
        identity = torch.eye(self.means.shape[-1], dtype=self.means.dtype, device=self.means.device)
        filler = identity.expand(self.weights.shape[0], extra, -1, -1)
        return Components(
            weights=torch.nn.functional.pad(self.weights, (0, extra)),
            means=torch.nn.functional.pad(self.means, (0, 0, 0, extra)),
            covariances=torch.cat([self.covariances, filler], 1),
            factors=torch.cat([self.factors, filler], 1),
        )

    def absent(self) -> Components:
        """Mixtures of the same shape without any component."""
        return Components.create(torch.zeros_like(self.weights), self.means, self.covariances)

    def _tensors(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        return self.weights, self.means, self.covariances, self.factors


def _expand(tensor: Tensor, like: Tensor) -> Tensor:
    """Append axes of length 1 until `tensor` has as many as `like`."""
    return tensor.reshape(tensor.shape + (1,) * (like.ndim - tensor.ndim))
