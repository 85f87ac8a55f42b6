"""E-step and sufficient statistics over tiles: the one file that knows the memory layout.

log(pi_k N(x; mu_k, S_k)) is linear in the lifted features phi(x) = [1, x_a, x_a x_b (a <= b)] of a point, so with
eta_k the natural parameters of a component

    logits = eta phi       (E-step: one matrix product)        r = softmax(logits)
    statistics = r w phi^T (M-step: one matrix product).

A cell of points enters by the mean of phi over it, which needs only its mean and its spread. The covariance floor
delta^2 I is a spread that every point has; since sum_k r_k tr(P_k) delta^2 / 2 is the same for all points, it
goes into the constant of eta.

Layout. The points of a cloud are sorted along a space-filling curve and cut into tiles of T points; coordinates are
kept relative to the centre of their tile, so that float32 products lose nothing that matters. Every tile has an owner
cloud, and one `bmm` serves clouds of any size: eta (G, K, F) times phi (G, F, T) gives logits (G, K, T), components on
the rows. The tiles pass in chunks whose logits stay in the processor's cache. Padding points have weight 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.clouds import PointClouds
from gmmtorch.components import Components

__all__ = ["Statistics", "Tiles", "expectation", "log_likelihood"]

TILE = 256
_CHUNK_BYTES = 1 << 20  # of logits that pass at once: they stay in the second-level cache
_CUDA_CHUNK_BYTES = 1 << 28
_CLAMP = -60.0  # exp of less is a denormal number in float32, and those are 10 times slower; e^-60 = 1e-26


@dataclass(frozen=True)
class Tiles:
    """The points of a batch, in the layout of the kernel.

    Attributes:
        local: coordinates relative to the tile's centre (G, D, T) float64.
        spreads: packed spreads of cells (G, D (D + 1) / 2, T) float64, or None.
        weights: point weights, 0 for padding (G, 1, T) in the arithmetic's dtype.
        features: phi of every point (G, F, T) in the arithmetic's dtype.
        centers: tile centres (G, D) float64.
        owner: cloud of every tile (G,) int64.
        counts: tiles of every cloud (B,), on the host.
    """

    local: Tensor
    spreads: Tensor | None
    weights: Tensor
    features: Tensor
    centers: Tensor
    owner: Tensor
    counts: tuple[int, ...]

    @staticmethod
    def build(clouds: PointClouds) -> Tiles:
        """Sort, cut and lift a batch of normalised clouds."""
        counts = tuple(-(-n // TILE) for n in clouds.sizes)
        owner = torch.repeat_interleave(torch.tensor(counts, device=clouds.device), output_size=sum(counts))
        source, real = _tile_sources(clouds, counts, owner)
        points = clouds.points[source]  # (G, T, D)
        mask = real[..., None]
        centers = torch.where(mask, points, 0.0).sum(1) / real.sum(1, keepdim=True).clamp_min(1)
        local = torch.where(mask, points - centers[:, None], 0.0).transpose(1, 2).contiguous()  # (G, D, T)
        spreads = None
        if clouds.spreads is not None:
            packed = linalg.pack_symmetric(clouds.spreads)[source]  # (G, T, D (D + 1) / 2)
            spreads = torch.where(mask, packed, 0.0).transpose(1, 2).contiguous()
        weights = torch.where(real, clouds.weights[source], 0.0)[:, None].to(clouds.dtype)
        features = lift(local, spreads, clouds.dtype)
        return Tiles(local, spreads, weights, features, centers, owner, counts)

    def take(self, clouds: Sequence[int]) -> Tiles:
        """Copy the tiles of these clouds (B',), known on the host, in this order."""
        starts = [0]
        for count in self.counts:
            starts.append(starts[-1] + count)
        rows = torch.cat([torch.arange(starts[b], starts[b + 1]) for b in clouds]).to(self.owner.device)
        counts = tuple(self.counts[b] for b in clouds)
        owner = torch.repeat_interleave(torch.tensor(counts, device=rows.device), output_size=sum(counts))
        spreads = None if self.spreads is None else self.spreads[rows]
        return Tiles(
            self.local[rows],
            spreads,
            self.weights[rows],
            self.features[rows],
            self.centers[rows],
            owner,
            counts,
        )

    @property
    def batch_size(self) -> int:
        """Number of clouds B."""
        return len(self.counts)


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
    to_center = tiles.centers[:, None] - components.means[tiles.owner]  # (G, K, D)
    slack = 0.5 * floor[:, None].square() * components.precisions.diagonal(dim1=-2, dim2=-1).sum(-1)  # (B, K)
    slack = torch.where(components.weights > 0, slack, 0.0)
    dtype = tiles.features.dtype
    eta = _local_natural_parameters(components, slack, tiles.owner, to_center).to(dtype)  # (G, K, F)
    # Row 0 sums the responsibilities, row 1 sums them without the floor's share of the exponent.
    sums = (
        torch.stack([torch.zeros_like(slack), slack.clamp_max(60.0)], 1).exp().to(dtype)[tiles.owner]
    )  # (G, 2, K)
    moments = torch.empty_like(eta)
    values = eta.new_empty(eta.shape[0], 2, TILE)
    peaks = eta.new_empty(eta.shape[0], 1, TILE)
    for rows in _chunks(tiles, eta.shape[1]):
        features, weights = tiles.features[rows], tiles.weights[rows]
        likelihoods = torch.bmm(eta[rows], features)  # (g, K, T)
        torch.amax(likelihoods, 1, keepdim=True, out=peaks[rows])
        likelihoods.sub_(peaks[rows]).clamp_(min=_CLAMP).exp_()
        torch.bmm(sums[rows], likelihoods, out=values[rows])
        weighted = features * (weights / values[rows, :1])  # (g, F, T)
        torch.bmm(likelihoods, weighted.transpose(1, 2), out=moments[rows])
    objective = tiles.weights * (values.log_() + peaks)  # (G, 2, T)
    totals = _sum_over_tiles(objective.sum(-1, dtype=torch.float64), tiles)  # (B, 2)
    counts, first, second = _about_reference(moments.double(), to_center, tiles)
    return Statistics(counts, first, second, components.means, totals[:, 0], totals[:, 1])


def log_likelihood(tiles: Tiles, components: Components) -> Tensor:
    """Total log-likelihood of every cloud, always in float64 (B,), nats in normalised coordinates."""
    to_center = tiles.centers[:, None] - components.means[tiles.owner]
    eta = _local_natural_parameters(components, torch.zeros_like(components.weights), tiles.owner, to_center)
    per_tile = eta.new_empty(eta.shape[0], 1)
    for rows in _chunks(tiles, eta.shape[1], torch.float64):
        spreads = None if tiles.spreads is None else tiles.spreads[rows]
        logits = torch.bmm(eta[rows], lift(tiles.local[rows], spreads, torch.float64))
        peak = logits.amax(1, keepdim=True)
        value = logits.sub_(peak).clamp_(min=_CLAMP).exp_().sum(1, keepdim=True).log_().add_(peak)
        per_tile[rows] = (value * tiles.weights[rows]).sum(-1)
    return _sum_over_tiles(per_tile, tiles)[:, 0]


def lift(local: Tensor, spreads: Tensor | None, dtype: torch.dtype) -> Tensor:
    """Phi = [1, x_a, x_a x_b + S_ab (a <= b)], the mean of the features over a cell: (G, D, T) -> (G, F, T)."""
    dim = local.shape[1]
    features = local.new_empty(local.shape[0], linalg.num_lifted(dim), local.shape[2], dtype=dtype)
    features[:, 0] = 1.0
    features[:, 1 : 1 + dim] = local
    for i, (a, b) in enumerate(zip(*linalg.triangle(dim), strict=True)):
        product = local[:, a] * local[:, b]
        features[:, 1 + dim + i] = product if spreads is None else product + spreads[:, i]
    return features


def _chunks(tiles: Tiles, num_components: int, dtype: torch.dtype | None = None) -> list[slice]:
    """Cut the tiles into runs whose logits fit in the cache."""
    size = torch.finfo(dtype or tiles.features.dtype).bits // 8 * TILE * num_components
    budget = _CUDA_CHUNK_BYTES if tiles.features.is_cuda else _CHUNK_BYTES
    step = max(1, budget // size)
    num_tiles = tiles.owner.shape[0]
    return [slice(g, min(g + step, num_tiles)) for g in range(0, num_tiles, step)]


def _local_natural_parameters(
    components: Components, slack: Tensor, owner: Tensor, to_center: Tensor
) -> Tensor:
    """Eta of every component for coordinates relative to each tile's centre (G, K, F) float64."""
    dim = to_center.shape[-1]
    precisions = components.precisions  # (B, K, D, D)
    quadratic = linalg.pack_symmetric(-precisions)  # x^T P x has every product x_a x_b, a < b, twice
    quadratic[..., linalg.diagonal_positions(dim)] *= 0.5
    of_owner = precisions[owner]  # (G, K, D, D)
    slope = sum(of_owner[..., a] * to_center[..., a, None] for a in range(dim))  # (G, K, D)
    constant = (components.log_scales - slack)[owner] - 0.5 * (slope * to_center).sum(-1)
    return torch.cat([constant[..., None], -slope, quadratic[owner]], -1)


def _about_reference(moments: Tensor, to_center: Tensor, tiles: Tiles) -> tuple[Tensor, Tensor, Tensor]:
    """Shift the moments of every tile (G, K, F) to the old means and add them up per cloud."""
    dim = to_center.shape[-1]
    counts, first, second = moments.split([1, dim, moments.shape[-1] - 1 - dim], -1)
    rows, cols = (torch.tensor(i, device=moments.device) for i in linalg.triangle(dim))
    shifted = first + counts * to_center
    second = second + first[..., rows] * to_center[..., cols] + to_center[..., rows] * shifted[..., cols]
    total = _sum_over_tiles(torch.cat([counts, shifted, second], -1).flatten(1), tiles)
    total = total.unflatten(1, moments.shape[1:])
    return total[..., 0], total[..., 1 : 1 + dim], linalg.unpack_symmetric(total[..., 1 + dim :], dim)


def _sum_over_tiles(values: Tensor, tiles: Tiles) -> Tensor:
    """Add up the rows of every cloud, in order: (G, C) -> (B, C)."""
    starts = torch.tensor([0, *tiles.counts[:-1]], device=values.device).cumsum(0)
    rows = torch.arange(values.shape[0], device=values.device)
    return torch.nn.functional.embedding_bag(rows, values, starts, mode="sum")


def _tile_sources(clouds: PointClouds, counts: Sequence[int], owner: Tensor) -> tuple[Tensor, Tensor]:
    """Point that fills each place of each tile (G, T) int64, and whether it is one, not padding (G, T) bool."""
    order = _spatial_order(clouds)
    device = clouds.device
    first_tile = torch.tensor([0, *counts], device=device).cumsum(0)[owner]
    rank = (torch.arange(owner.shape[0], device=device) - first_tile)[:, None] * TILE
    rank = rank + torch.arange(TILE, device=device)
    sizes = torch.tensor(clouds.sizes, device=device)[owner, None]
    starts = torch.tensor(clouds.offsets[:-1], device=device)[owner, None]
    return order[starts + torch.minimum(rank, sizes - 1)], rank < sizes


def _spatial_order(clouds: PointClouds) -> Tensor:
    """Order of the points along a Morton curve within each cloud (N,) int64.

    x / (1 + |x|) brings the whole line into (-1, 1), so that one far outlier does not flatten the curve.
    """
    dim = clouds.dim
    bits = min(10, 40 // dim)
    unit = clouds.points / (1.0 + clouds.points.abs())
    cells = ((unit + 1.0) * (0.5 * 2**bits)).long().clamp_(0, 2**bits - 1)  # (N, D)
    codes = torch.arange(2**bits, device=clouds.device)
    spread = sum(((codes >> i) & 1) << (i * dim) for i in range(bits))
    assert isinstance(spread, Tensor)
    key = clouds.cloud_index << 40
    for a in range(dim):
        key = key + (spread[cells[:, a]] << a)
    return torch.sort(key, stable=True).indices
