"""E-step and sufficient statistics: the kernel, which reads the points tile by tile (`gmmtorch.tiles`).

log(pi_k N(x; mu_k, S_k)) is linear in the lifted features phi(x) = [1, x_a, x_a x_b (a <= b)] of a point, so with
eta_k the natural parameters of a component

    logits = eta phi       (E-step: one matrix product)        r = softmax(logits)
    statistics = r w phi^T (M-step: one matrix product).

The covariance floor delta^2 I is a spread that every point has; since sum_k r_k tr(P_k) delta^2 / 2 is the same for all
points, it goes into the constant of eta.

One `bmm` serves clouds of any size: eta (G, K, F) times phi (G, F, T) gives logits (G, K, T), components on the rows.
The tiles pass in chunks whose logits stay in the cache. On a CPU `gmmtorch.compiled` makes the same pass in
loops that Numba compiles.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.components import Components
from gmmtorch.tiles import TILE, Tiles, lift

__all__ = ["Statistics", "expectation", "log_likelihood", "total_covariance"]

_CHUNK_BYTES = 1 << 21  # of logits that pass at once: they stay in the second-level caches
_CUDA_CHUNK_BYTES = 1 << 28
LARGEST_SLACK = 60.0  # of a start that is thinner than the floor: exp stays finite
_CLAMP = -60.0  # exp of much less gives denormal numbers, which are 10 times slower; e^-60 = 1e-26


@dataclass(frozen=True)
class Statistics:
    """What the M-step needs, and the value of the mixture that the E-step saw.

    Attributes:
        counts: N_k = sum_n w_n r_nk (B, K) float64.
        first: sum_n w_n r_nk (x_n - reference_k) (B, K, D) float64.
        second: sum_n w_n r_nk ((x_n - reference_k)(x_n - reference_k)^T + spread_n) (B, K, D, D) float64.
        reference: the means of the mixture (B, K, D): moments about them lose no digits.
        objective: log-likelihood of points that have the spread of the floor (B,) float64, nats; EM never lowers it.
        log_likelihood: log-likelihood of the points (B,) float64, nats.
    """

    counts: Tensor
    first: Tensor
    second: Tensor
    reference: Tensor
    objective: Tensor
    log_likelihood: Tensor

    def take(self, clouds: Tensor) -> Statistics:
        """Statistics of these clouds (B',) int64."""
        return Statistics(*(getattr(self, f.name).index_select(0, clouds) for f in fields(self)))

    def where(self, condition: Tensor, other: Statistics) -> Statistics:
        """Keep these statistics where the condition (B,) bool holds, those of `other` elsewhere."""
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return Statistics(
            *(
                torch.where(condition.view(-1, *[1] * (mine.dim() - 1)), mine, theirs)
                for mine, theirs in pairs
            )
        )

    def covariances(self) -> Tensor:
        """Covariance of the share of every component, without any floor (B, K, D, D); 0 where N_k is 0."""
        counts = torch.where(self.counts > 0, self.counts, 1.0)[..., None]
        shift = self.first / counts
        return self.second / counts[..., None] - shift[..., :, None] * shift[..., None, :]


def expectation(tiles: Tiles, components: Components, floor: Tensor) -> Statistics:
    """E-step: responsibilities of all points, and their sufficient statistics.

    Args:
        tiles: the batch.
        components: the mixtures, in the same coordinates.
        floor: standard deviation delta that belongs to every point (B,).
    """
    if tiles.on_cpu:
        return _compiled(tiles, components, floor)
    precisions = components.precisions  # (B, K, D, D)
    slack = 0.5 * floor[:, None].square() * precisions.diagonal(dim1=-2, dim2=-1).sum(-1)  # (B, K)
    slack = torch.where(components.weights > 0, slack, 0.0)
    # The factors that take the floor's share of the exponent back.
    bare = slack.clamp_max(LARGEST_SLACK).exp().to(tiles.dtype)
    log_scales = components.log_scales - slack
    moments, values = _by_tensor_operations(tiles, log_scales, bare, precisions, components.means)
    totals = _sum_over_tiles(values, tiles)  # (B, 2)
    counts, first, second = _parts(moments, components.means.shape[2])
    return Statistics(counts, first, second, components.means, totals[:, 0], totals[:, 1])


def _compiled(tiles: Tiles, components: Components, floor: Tensor) -> Statistics:
    """What `expectation` gives, by compiled loops."""
    from gmmtorch.compiled.em import expect  # 0.4 s: the import of Numba

    moments, totals = expect(tiles, components, floor, tiles.dtype)
    counts, first, second = _parts(moments, components.means.shape[2])
    return Statistics(counts, first, second, components.means, totals[:, 0], totals[:, 1])


def _by_tensor_operations(
    tiles: Tiles, log_scales: Tensor, bare: Tensor, precisions: Tensor, means: Tensor
) -> tuple[Tensor, Tensor]:
    """Moments of every cloud about the means (B, K, F), and the values of every tile (G, 2), float64."""
    to_center = tiles.centers[:, :, None] - _of_tile(means.transpose(1, 2), tiles)  # (G, D, K)
    eta = _natural_parameters(log_scales, precisions, to_center, tiles, tiles.dtype)
    sums = torch.stack([torch.ones_like(bare), bare], 1)
    moments, values = _pass_over_points(tiles, eta, _of_tile(sums, tiles))
    return _about_means(moments.double(), to_center, tiles), values.squeeze(-1).double()


def total_covariance(tiles: Tiles) -> Tensor:
    """Covariance of every whole cloud of a batch just built (B, D, D) float64, spreads included."""
    storage, num_features = tiles.storage, linalg.num_lifted(tiles.centers.shape[1])
    moments = storage.centers.new_empty(len(tiles.centers), num_features, 1)
    for rows, stored in _chunks(tiles, num_features, torch.float64):
        spreads = None if storage.spreads is None else storage.spreads[stored]
        features = lift(
            storage.local[stored], spreads, torch.float64
        )  # float32 loses the start of an exact plane
        torch.sum(features * storage.weights[stored], 2, keepdim=True, out=moments[rows])  # (g, F, 1)
    about_origin = _about_means(moments, tiles.centers[..., None], tiles)
    counts, first, second = _parts(about_origin, tiles.centers.shape[1])
    counts = torch.where(counts > 0, counts, 1.0)[..., None]  # (B, 1, 1)
    mean = first / counts
    return (second / counts[..., None] - mean[..., :, None] * mean[..., None, :])[:, 0]


def _pass_over_points(tiles: Tiles, eta: Tensor, sums: Tensor) -> tuple[Tensor, Tensor]:
    """The only work per point and component: two products with the features, and a softmax between them.

    Args:
        tiles: the batch.
        eta: natural parameters relative to the tiles' centres (G, F, K).
        sums: rows of factors by which the likelihoods are added up (G, 2, K); the first is all ones.

    Returns:
        Moments sum_n w_n r_nk phi_n (G, F, K), and sum_n w_n log of the sums of likelihoods (G, 2, 1), nats.
    """
    num_tiles, num_features, num_components = eta.shape
    moments, values = torch.empty_like(eta), eta.new_empty(num_tiles, 2, 1)
    chunks = _chunks(tiles, num_components, eta.dtype)
    size = max((rows.stop - rows.start for rows, _ in chunks), default=0)
    spaces = [eta.new_empty(size, n, TILE) for n in (num_components, num_features, 2, 1)]
    for rows, stored in chunks:
        likelihoods, weighted, totals, peak = (space[: rows.stop - rows.start] for space in spaces)
        features, weights = tiles.storage.features[stored], tiles.storage.weights[stored].to(eta.dtype)
        torch.bmm(eta[rows].transpose(1, 2), features, out=likelihoods)  # (g, K, T)
        torch.amax(likelihoods, 1, keepdim=True, out=peak)
        _exp_below(likelihoods, peak)
        torch.bmm(sums[rows], likelihoods, out=totals)  # (g, 2, T)
        torch.mul(features, weights / totals[:, :1], out=weighted)  # (g, F, T)
        torch.bmm(weighted, likelihoods.transpose(1, 2), out=moments[rows])
        torch.bmm(totals.log_().add_(peak), weights.transpose(1, 2), out=values[rows])
    return moments, values


def _exp_below(logits: Tensor, peak: Tensor) -> Tensor:
    """exp(logits - peak) in place, without the denormal numbers that make it 10 times slower."""
    return logits.sub_(peak).clamp_(min=_CLAMP).exp_()


def log_likelihood(tiles: Tiles, components: Components) -> Tensor:
    """Total log-likelihood of every cloud, always in float64 (B,), nats in normalised coordinates."""
    if tiles.on_cpu:
        return _compiled(
            tiles.in_double, components, torch.zeros_like(components.weights[:, 0])
        ).log_likelihood
    to_center = tiles.centers[:, :, None] - _of_tile(components.means.transpose(1, 2), tiles)
    eta = _natural_parameters(
        components.log_scales, components.precisions, to_center, tiles, torch.float64
    )  # (G, F, K)
    per_tile = eta.new_empty(eta.shape[0], 1)
    storage = tiles.storage
    for rows, stored in _chunks(tiles, eta.shape[2], torch.float64):
        spreads = None if storage.spreads is None else storage.spreads[stored]
        logits = torch.bmm(eta[rows].transpose(1, 2), lift(storage.local[stored], spreads, torch.float64))
        peak = logits.amax(1, keepdim=True)
        value = _exp_below(logits, peak).sum(1, keepdim=True).log_().add_(peak)
        per_tile[rows] = (value * storage.weights[stored]).sum(-1)
    return _sum_over_tiles(per_tile, tiles)[:, 0]


def _chunks(tiles: Tiles, num_components: int, dtype: torch.dtype) -> list[tuple[slice, slice]]:
    """Cut the runs into pieces of at least two tiles whose logits fit in the cache: tiles, places in the storage."""
    size = torch.finfo(dtype).bits // 8 * TILE * num_components
    budget = _CUDA_CHUNK_BYTES if tiles.storage.local.is_cuda else _CHUNK_BYTES
    most = max(2, budget // size)
    chunks = []
    for tile, start, length in tiles.runs:
        pieces = max(1, min(-(-length // most), length // 2))
        for a, b in itertools.pairwise(i * length // pieces for i in range(pieces + 1)):
            chunks.append((slice(tile + a, tile + b), slice(start + a, start + b)))
    return chunks


def _of_tile(values: Tensor, tiles: Tiles) -> Tensor:
    """Values of the cloud that owns each tile: (B, ...) -> (G, ...); a view for a batch of one."""
    if tiles.batch_size == 1:
        return values.expand(tiles.owner.shape[0], *values.shape[1:])
    return values.index_select(0, tiles.owner)


def _natural_parameters(
    log_scales: Tensor, precisions: Tensor, to_center: Tensor, tiles: Tiles, dtype: torch.dtype
) -> Tensor:
    """Return eta of every component, for coordinates relative to each tile's centre (G, F, K).

    With d = center - mu: eta = [log_scale - d P d / 2, -P d, -P_aa / 2 or -P_ab (a < b)], computed in float64.
    """
    dim = to_center.shape[1]
    rows = _of_tile(precisions.flatten(2).transpose(1, 2).contiguous(), tiles)  # (G, D D, K)
    eta = rows.new_empty(len(to_center), linalg.num_lifted(dim), to_center.shape[2], dtype=dtype)
    constant = _of_tile(log_scales, tiles)  # (G, K)
    for a in range(dim):
        slope = rows[:, a * dim] * to_center[:, 0]
        for b in range(1, dim):
            slope.addcmul_(rows[:, a * dim + b], to_center[:, b])
        constant = torch.addcmul(constant, slope, to_center[:, a], value=-0.5)
        torch.neg(slope, out=slope)
        eta[:, 1 + a] = slope
    eta[:, 0] = constant
    for i, (a, b) in enumerate(zip(*linalg.triangle(dim), strict=True)):
        eta[:, 1 + dim + i] = rows[:, a * dim + b] * (-0.5 if a == b else -1.0)
    return eta


def _about_means(moments: Tensor, to_center: Tensor, tiles: Tiles) -> Tensor:
    """Shift the moments of tiles (G, F, K) float64 to the old means, in place; add them up per cloud (B, K, F)."""
    dim = to_center.shape[1]
    count, first, second = moments[:, 0], moments[:, 1 : 1 + dim], moments[:, 1 + dim :]
    pairs = list(enumerate(zip(*linalg.triangle(dim), strict=True)))
    for i, (a, b) in pairs:  # (y + d)(y + d)^T = y y^T + y d^T + d (y + d)^T
        second[:, i].addcmul_(first[:, a], to_center[:, b])
    for a in range(dim):
        first[:, a].addcmul_(count, to_center[:, a])
    for i, (a, b) in pairs:
        second[:, i].addcmul_(to_center[:, a], first[:, b])
    return _sum_over_tiles(moments.flatten(1), tiles).unflatten(1, moments.shape[1:]).transpose(1, 2)


def _parts(moments: Tensor, dim: int) -> tuple[Tensor, Tensor, Tensor]:
    """Counts (B, K), first (B, K, D) and second moments (B, K, D, D) of packed ones (B, K, F)."""
    second = linalg.unpack_symmetric(moments[..., 1 + dim :], dim)
    return moments[..., 0], moments[..., 1 : 1 + dim], second


def _sum_over_tiles(values: Tensor, tiles: Tiles) -> Tensor:
    """Add up the rows of every cloud, in order: (G, C) -> (B, C)."""
    rows = torch.arange(values.shape[0], device=values.device)
    return torch.nn.functional.embedding_bag(rows, values, tiles.starts, mode="sum")
