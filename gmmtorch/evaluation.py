"""Evaluate a batch of mixtures at the points of their clouds: densities, responsibilities, expected counts.

With W_k = L_k^-1 from the Cholesky factor of S_k, a point or cell x of covariance Q (0 for a point) has the logits

    log(pi_k) - (D log(2 pi) + log|S_k|) / 2 - |W_k (x - mu_k)|^2 / 2 - tr(S_k^-1 Q) / 2.

The whitened coordinates are one matrix product with [x, 1], everything else is one with [1, Q]. The squares are taken
after the product and not before it, as the features of `statistics` do: on walls 1 mm thick x^T S^-1 x is a small
difference of terms of 1e8, which costs the seven digits that an answer for a caller should have, whereas the gain
would be a third of the time.

On a CPU a compiled loop does this (`gmmtorch.compiled.evaluation`). On a device: components on the rows, points on
the columns, in chunks that stay in the cache. A chunk may hold pieces of several clouds: matrix products are made per
piece, everything else once per chunk.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.clouds import PointClouds

if TYPE_CHECKING:
    from gmmtorch.compiled.evaluation import Evaluation

__all__ = ["Densities", "Posterior"]

_CHUNK = 1 << 16  # logits that pass at once
_CUDA_CHUNK = 1 << 24
_CLAMP = -700.0  # where exp leaves the normal numbers, of which it takes 80 times as long
_NOTHING = 1e-304  # just above exp of the clamp: what is not more is exactly 0, as it is for padding


@dataclass(frozen=True, eq=False)
class Posterior:
    """What a mixture says of every point of its cloud.

    Attributes:
        log_prob: log p(x_n) (N,), nats; -inf where the mixture is empty, NaN where the point is not finite.
        responsibilities: r_nk (N, K); rows sum to 1, or are 0 where the mixture is empty.
        components: argmax_k r_nk (N,) int64; -1 where the mixture is empty.
    """

    log_prob: Tensor
    responsibilities: Tensor
    components: Tensor


class _Piece(NamedTuple):
    """Consecutive points of one cloud: where they lie in the batch, and which columns of a chunk they fill."""

    cloud: int
    points: slice
    columns: slice


class _Chunk(NamedTuple):
    """Consecutive points of a batch, their pieces, and their logits (K, T), which the reader may overwrite."""

    points: slice
    pieces: Sequence[_Piece]
    logits: Tensor


@dataclass(frozen=True)
class Densities:
    """B mixtures, to be evaluated.

    Attributes:
        weights: pi_k (B, K), 0 for padding.
        means: mu_k (B, K, D).
        factors: lower Cholesky factors of the covariances (B, K, D, D).
    """

    weights: Tensor
    means: Tensor
    factors: Tensor

    @staticmethod
    def of(weights: Tensor, means: Tensor, covariances: Tensor) -> Densities:
        """Prepare mixtures of weights (B, K), means (B, K, D) and covariances (B, K, D, D)."""
        return Densities(weights, means, linalg.safe_cholesky(covariances)[0])

    @cached_property
    def origin(self) -> Tensor:
        """Mean of every mixture (B, D), m: coordinates about it lose no digits."""
        return (self.weights[..., None] * self.means).sum(1)

    @cached_property
    def whitening(self) -> Tensor:
        """[W_k, -W_k mu_k] of all components, one coordinate after the other (B, D K, D + 1)."""
        identity = torch.eye(self.means.shape[-1], dtype=self.means.dtype, device=self.means.device)
        inverse = torch.linalg.solve_triangular(self.factors, identity.expand_as(self.factors), upper=False)
        offsets = inverse @ (self.means - self.origin[:, None])[..., None]  # (B, K, D, 1)
        return torch.cat([inverse, -offsets], -1).transpose(1, 2).flatten(1, 2)

    @cached_property
    def linear(self) -> Tensor:
        """Coefficients of [1, Q_ab (a <= b)] in the logits (B, K, 1 + D (D + 1) / 2)."""
        dim = self.means.shape[-1]
        log_volume = dim * math.log(2 * math.pi) + linalg.log_determinant(self.factors)
        once = 2.0 - torch.eye(
            dim, dtype=self.means.dtype, device=self.means.device
        )  # Q_ab stands for Q_ba too
        precisions = linalg.pack_symmetric(-0.5 * once * linalg.precision_matrix(self.factors))
        return torch.cat([(self.weights.log() - 0.5 * log_volume)[..., None], precisions], -1)

    def log_prob(self, clouds: PointClouds) -> Tensor:
        """Log p(x_n) (N,)."""
        if _on_cpu(clouds):
            return self._compiled(clouds, log_prob=True).log_prob
        result = clouds.points.new_empty(len(clouds.points))
        for chunk in self._chunks(clouds):
            peak = chunk.logits.amax(0)
            result[chunk.points] = _exponentiate(chunk.logits, peak).log().add_(peak)
        return result

    def components(self, clouds: PointClouds) -> Tensor:
        """argmax_k r_nk (N,) int64, -1 where the mixture is empty."""
        if _on_cpu(clouds):
            return self._compiled(clouds, components=True).components
        result = torch.empty(len(clouds.points), dtype=torch.int64, device=clouds.device)
        for chunk in self._chunks(clouds):
            result[chunk.points] = _component(*chunk.logits.max(0))
        return result

    def responsibilities(self, clouds: PointClouds) -> Tensor:
        """r_nk (N, K), each component's in consecutive memory."""
        if _on_cpu(clouds):
            return self._compiled(clouds, responsibilities=True).responsibilities.T
        result = clouds.points.new_empty(self.linear.shape[1], len(clouds.points))
        for chunk in self._chunks(clouds):
            total = _exponentiate(chunk.logits, chunk.logits.amax(0))
            torch.mul(chunk.logits, _reciprocal(total), out=result[:, chunk.points])
        return result.T

    def posterior(self, clouds: PointClouds) -> Posterior:
        """All three in one pass."""
        if _on_cpu(clouds):
            found = self._compiled(clouds, log_prob=True, responsibilities=True, components=True)
            return Posterior(found.log_prob, found.responsibilities.T, found.components)
        size = len(clouds.points)
        responsibilities = clouds.points.new_empty(self.linear.shape[1], size)
        log_prob = clouds.points.new_empty(size)
        components = torch.empty(size, dtype=torch.int64, device=clouds.device)
        for chunk in self._chunks(clouds):
            peak, index = chunk.logits.max(0)
            components[chunk.points] = _component(peak, index)
            total = _exponentiate(chunk.logits, peak)
            torch.mul(chunk.logits, _reciprocal(total), out=responsibilities[:, chunk.points])
            log_prob[chunk.points] = total.log_().add_(peak)
        return Posterior(log_prob, responsibilities.T, components)

    def expected_counts(self, clouds: PointClouds) -> Tensor:
        """sum_n w_n r_nk (B, K)."""
        if _on_cpu(clouds):
            return self._compiled(clouds, counts=True).counts
        counts = self.linear.new_zeros(self.linear.shape[:2])
        for chunk in self._chunks(clouds):
            total = _exponentiate(chunk.logits, chunk.logits.amax(0))
            shares = clouds.weights[chunk.points] * _reciprocal(total)
            for piece in chunk.pieces:
                counts[piece.cloud] += chunk.logits[:, piece.columns] @ shares[piece.columns]
        return counts

    def _compiled(self, clouds: PointClouds, **wanted: bool) -> Evaluation:
        from gmmtorch.compiled.evaluation import evaluate  # 0.4 s: the import of Numba

        return evaluate(self.weights, self.means, self.factors, clouds, **wanted)

    def _chunks(self, clouds: PointClouds) -> Iterator[_Chunk]:
        """The logits of all points, chunk by chunk; the memory of one chunk is that of the next."""
        K, dim = self.linear.shape[1], clouds.dim
        plan = _plan(clouds.offsets, max(1, (_CUDA_CHUNK if clouds.points.is_cuda else _CHUNK) // K))
        longest = max((pieces[-1].columns.stop for pieces in plan), default=0)
        num_features = linalg.num_lifted(dim) if clouds.spreads is not None else dim + 1
        sizes = (num_features, dim * K, K)
        spaces = [clouds.points.new_empty(rows * longest) for rows in sizes]
        for pieces in plan:
            length = pieces[-1].columns.stop
            features, whitened, logits = (
                space[: rows * length].view(rows, length) for space, rows in zip(spaces, sizes, strict=True)
            )
            points = slice(pieces[0].points.start, pieces[-1].points.stop)
            features[dim] = 1.0
            if clouds.spreads is not None:
                features[dim + 1 :] = linalg.pack_symmetric(clouds.spreads[points]).T
            for piece in pieces:
                self._multiply(clouds, piece, features, whitened, logits)
            for coordinate in whitened.view(dim, K, length):
                logits.addcmul_(coordinate, coordinate, value=-0.5)
            yield _Chunk(points, pieces, logits)

    def _multiply(
        self, clouds: PointClouds, piece: _Piece, features: Tensor, whitened: Tensor, logits: Tensor
    ) -> None:
        """Fill a piece's columns: the coordinates of the features, whitened coordinates, linear part of the logits."""
        b, columns, dim = piece.cloud, piece.columns, clouds.dim
        coordinates = features[:dim, columns]
        torch.sub(clouds.points[piece.points].T, self.origin[b, :, None], out=coordinates)
        torch.mm(self.whitening[b], features[: dim + 1, columns], out=whitened[:, columns])
        linear = self.linear[b, :, : len(features) - dim]
        torch.mm(linear, features[dim:, columns], out=logits[:, columns])


def _on_cpu(clouds: PointClouds) -> bool:
    """Whether the compiled loop can read the points."""
    return clouds.points.device.type == "cpu"


def _plan(offsets: Sequence[int], longest: int) -> list[list[_Piece]]:
    """Cut every cloud into equal pieces of at most `longest` points, and fill chunks of at most as many with them.

    How a cloud is cut does not depend on the others, so that its numbers do not either.
    """
    plan: list[list[_Piece]] = []
    for cloud, (first, last) in enumerate(itertools.pairwise(offsets)):
        parts = -(-(last - first) // longest)
        for part in range(parts):
            start, stop = (first + (last - first) * i // parts for i in (part, part + 1))
            begin = plan[-1][-1].columns.stop if plan else longest
            if begin + stop - start > longest:
                plan.append([])
                begin = 0
            plan[-1].append(_Piece(cloud, slice(start, stop), slice(begin, begin + stop - start)))
    return plan


def _exponentiate(logits: Tensor, peak: Tensor) -> Tensor:
    """exp(logits - peak) in place; returns the sum over the components (T,), 0 where the mixture is empty."""
    lowest = torch.finfo(logits.dtype).min  # -inf - -inf would be NaN
    logits.sub_(peak.clamp_min(lowest)).clamp_(min=_CLAMP).exp_()
    return torch.threshold_(logits, _NOTHING, 0.0).sum(0)


def _reciprocal(total: Tensor) -> Tensor:
    """1 / total; it is 0 or at least 1, and of 0 nothing is to be shared out."""
    return 1.0 / total.clamp_min(1.0)


def _component(peak: Tensor, index: Tensor) -> Tensor:
    """The index of the largest logit, -1 where all are -inf, and where the point is not finite."""
    return torch.where((peak == -torch.inf) | peak.isnan(), -1, index)
