"""Where the components start: one registry of initialisers.

Most initialisers give means; the components then begin with equal weights and the covariance of the whole cloud
(section 2.3). `merged` and `from_mixtures` give weights and covariances too. The description length that the search
reaches depends on the start more than on anything else.

Random streams depend on (seed, initialisation number) only: every cloud of a batch draws the same numbers, so that its
result does not depend on its place in the batch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.clouds import PointClouds
from gmmtorch.errors import ArgumentError
from gmmtorch.hierarchy import Groups, merged_groups
from gmmtorch.normalization import subsample

__all__ = ["INITIALIZERS", "Initializer", "initial_groups"]

Initializer = Callable[[PointClouds, Sequence[int], int, torch.Generator, Groups | None], Tensor | Groups]
"""(clouds, num_components (B,), initialisation number, generator, mixtures already known) -> means (B, K, D), or groups
with weights and covariances as well, in normalised coordinates. Slots from num_components[b] on are ignored."""

_SEEDING_SAMPLE = 2048
_NEIGHBOURS = 8  # sampled points to which a seed's component reaches at first
_NARROWEST = 1e-3  # of the cloud's extent: its least standard deviation


def initial_groups(
    name: str,
    clouds: PointClouds,
    num_components: Sequence[int],
    seed: int,
    initialization: int,
    known: Groups | None = None,
) -> Tensor | Groups:
    """Run the initialiser of this name for K slots, the largest of `num_components` (B,).

    Raises:
        ArgumentError: if the name is not registered.
    """
    if name not in INITIALIZERS:
        raise ArgumentError(f"unknown initializer {name!r}; choose one of {', '.join(sorted(INITIALIZERS))}")
    generator = torch.Generator().manual_seed((seed << 16) + initialization)
    return INITIALIZERS[name](clouds, num_components, initialization, generator, known)


def evenly_spaced(
    clouds: PointClouds,
    num_components: Sequence[int],
    initialization: int,
    generator: torch.Generator,
    known: Groups | None = None,
) -> Tensor:
    """mu_k = y_n, n = floor((k - 1)(N - 1) / (K - 1)) + 1, in scan order (paper, section 2.3).

    There is one such start; initialisations after the first are those of `random_points`.
    """
    if initialization > 0:
        return random_points(clouds, num_components, initialization, generator)
    slots, sizes, counts = _slots(clouds, num_components)
    position = slots * (sizes - 1).clamp_min(0) // (counts - 1).clamp_min(1)
    return _points_at(clouds, position)


def random_points(
    clouds: PointClouds,
    num_components: Sequence[int],
    initialization: int,
    generator: torch.Generator,
    known: Groups | None = None,
) -> Tensor:
    """One point from each of K equal stretches of the scan, so that all are different."""
    slots, sizes, counts = _slots(clouds, num_components)
    jitter = _uniform(slots.numel(), generator).to(clouds.device)
    position = ((slots + jitter) * sizes / counts.clamp_min(1)).long()
    return _points_at(clouds, position)


def kmeans_plus_plus(
    clouds: PointClouds,
    num_components: Sequence[int],
    initialization: int,
    generator: torch.Generator,
    known: Groups | None = None,
) -> Tensor:
    """Each mean is a point drawn in proportion to its squared distance to the means before it.

    Arthur & Vassilvitskii (2007), on at most 2 048 points per cloud.
    """
    index, mask = subsample(clouds, _SEEDING_SAMPLE)
    points = clouds.points[index]  # (B, S, D)
    share = torch.where(mask, clouds.weights[index], 0.0)
    uniform = _uniform(max(num_components), generator).to(clouds.device)
    distance = torch.ones_like(share)
    means = []
    for k in range(max(num_components)):
        mean = _drawn(points, mask, share * distance, uniform[k])
        to_mean = (points - mean).square().sum(-1)
        distance = to_mean if k == 0 else torch.minimum(distance, to_mean)
        means.append(mean)
    return torch.cat(means, 1)


def merged(
    clouds: PointClouds,
    num_components: Sequence[int],
    initialization: int,
    generator: torch.Generator,
    known: Groups | None = None,
) -> Tensor | Groups:
    """Groups of a fine partition joined by eq. 7, see `gmmtorch.hierarchy`.

    There is one such start; initialisations after the first are those of `kmeans++`.
    """
    if initialization > 0:
        return kmeans_plus_plus(clouds, num_components, initialization, generator)
    return merged_groups(clouds, num_components)


def from_mixtures(
    clouds: PointClouds,
    num_components: Sequence[int],
    initialization: int,
    generator: torch.Generator,
    known: Groups | None = None,
) -> Groups:
    """Known mixtures, and beside them components seeded where they explain the cloud worst.

    A seed is drawn in proportion to how far the log-density of a point lies below the cloud's median, times its squared
    distance to the seeds before it, on at most 2 048 points per cloud. It begins as a ball as wide as the distance to
    its neighbours, with the share of points of an average component.

    Raises:
        ArgumentError: if there are no known mixtures, or one of them has more than K components.
    """
    if known is None:
        raise ArgumentError("the initializer 'from_mixtures' needs mixtures to start from: pass `initial`")
    counts = torch.tensor(list(num_components), device=clouds.device)
    present = (known.weights > 0).sum(1)
    if bool((present > counts).any()):
        raise ArgumentError(
            f"an initial mixture has {int(present.max())} components, more than the largest order asked for; raise "
            "max_components"
        )
    seeds, widths = _worst_explained(clouds, known, max(num_components), generator)
    slots = torch.arange(max(num_components), device=clouds.device)
    old = slots < present[:, None]  # (B, K)
    identity = torch.eye(clouds.dim, dtype=torch.float64, device=clouds.device)
    missing = max(0, len(slots) - known.weights.shape[1])
    which = (slots - present[:, None]).clamp_min(0)  # the first seed for the first slot that is free
    seeds, widths = torch.take_along_dim(seeds, which[..., None], 1), torch.take_along_dim(widths, which, 1)
    weights = torch.nn.functional.pad(known.weights, (0, missing))[:, : len(slots)]
    means = torch.nn.functional.pad(known.means, (0, 0, 0, missing))[:, : len(slots)]
    covariances = torch.nn.functional.pad(known.covariances, (0, 0, 0, 0, 0, missing))[:, : len(slots)]
    share = 1.0 / counts[:, None].clamp_min(1).double()
    return Groups(
        weights=torch.where(old, weights * present[:, None] * share, share),
        means=torch.where(old[..., None], means, seeds),
        covariances=torch.where(old[..., None, None], covariances, widths[..., None, None] ** 2 * identity),
    )


def _worst_explained(
    clouds: PointClouds, known: Groups, count: int, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Points that the known mixtures explain worst (B, K, D), and the distance to their neighbours (B, K)."""
    index, mask = subsample(clouds, _SEEDING_SAMPLE)
    points = clouds.points[index]  # (B, S, D)
    share = torch.where(mask, clouds.weights[index], 0.0)
    log_prob = _log_prob(points, known)
    typical = torch.where(mask, log_prob, torch.nan).nanmedian(1, keepdim=True).values
    excess = torch.where(mask, (typical - log_prob).clamp_min(0.0), 0.0).nan_to_num(0.0)
    # Where nothing is explained worse than the rest, any point may be a seed.
    excess = torch.where(excess.sum(1, keepdim=True) > 0, excess, 1.0)
    uniform = _uniform(count, generator).to(clouds.device)
    distance, seeds, widths = torch.ones_like(share), [], []
    for k in range(count):
        seed = _drawn(points, mask, share * excess * distance, uniform[k])
        to_seed = (points - seed).square().sum(-1)
        near = torch.where(mask, to_seed, torch.inf).topk(min(_NEIGHBOURS, points.shape[1]), largest=False)
        widths.append(near.values.amax(1).nan_to_num(posinf=1.0).clamp_min(_NARROWEST**2).sqrt())
        distance = to_seed if k == 0 else torch.minimum(distance, to_seed)
        seeds.append(seed)
    return torch.cat(seeds, 1), torch.stack(widths, 1)


def _log_prob(points: Tensor, mixtures: Groups) -> Tensor:
    """Log-density of sampled points (B, S, D) under their mixtures (B, S), nats."""
    factors = linalg.safe_cholesky(mixtures.covariances)[0]
    away = points[:, None] - mixtures.means[:, :, None]  # (B, K, S, D)
    white = torch.linalg.solve_triangular(factors[:, :, None], away[..., None], upper=False)[..., 0]
    scales = mixtures.weights.log() - 0.5 * linalg.log_determinant(factors)
    return torch.logsumexp(scales[..., None] - 0.5 * white.square().sum(-1), 1)


INITIALIZERS: dict[str, Initializer] = {
    "evenly_spaced": evenly_spaced,
    "random_points": random_points,
    "kmeans++": kmeans_plus_plus,
    "merged": merged,
    "from_mixtures": from_mixtures,
}


def _slots(clouds: PointClouds, num_components: Sequence[int]) -> tuple[Tensor, Tensor, Tensor]:
    """Component numbers (1, K), and sizes and component counts of the clouds (B, 1)."""
    slots = torch.arange(max(num_components), device=clouds.device)[None]
    sizes = torch.tensor(clouds.sizes, device=clouds.device)[:, None]
    return slots, sizes, torch.tensor(list(num_components), device=clouds.device)[:, None]


def _points_at(clouds: PointClouds, position: Tensor) -> Tensor:
    """Points at these positions (B, K) of their clouds, clamped to the cloud (B, K, D)."""
    sizes = torch.tensor(clouds.sizes, device=clouds.device)[:, None]
    starts = torch.tensor(clouds.offsets[:-1], device=clouds.device)[:, None]
    inside = torch.minimum(position, (sizes - 1).clamp_min(0))
    last = max(clouds.points.shape[0] - 1, 0)
    return clouds.points[(starts + inside).clamp_max(last)]


def _drawn(points: Tensor, mask: Tensor, density: Tensor, uniform: Tensor) -> Tensor:
    """One of each cloud's points (B, S, D), drawn in proportion to the density (B, S) by a number in [0, 1)."""
    bounds = density.cumsum(1)
    chosen = torch.searchsorted(bounds, uniform * bounds[:, -1:], right=True)
    chosen = torch.minimum(chosen, (mask.sum(1, keepdim=True) - 1).clamp_min(0))
    return torch.take_along_dim(points, chosen[..., None], 1)


def _uniform(count: int, generator: torch.Generator) -> Tensor:
    """`count` numbers in [0, 1) whose first ones do not depend on `count`."""
    block = 4096
    blocks = [torch.rand(block, dtype=torch.float64, generator=generator) for _ in range(-(-count // block))]
    return torch.cat(blocks)[:count]
