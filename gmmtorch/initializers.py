"""Where the components start: one registry of initialisers.

Most initialisers give means; the components then begin with equal weights and the covariance of the whole cloud
(section 2.3). `merged` gives weights and covariances too. The description length that the search reaches depends on the
start more than on anything else.

Random streams depend on (seed, initialisation number) only: every cloud of a batch draws the same numbers, so that its
result does not depend on its place in the batch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from gmmtorch.clouds import PointClouds
from gmmtorch.errors import ArgumentError
from gmmtorch.hierarchy import Groups, merged_groups
from gmmtorch.normalization import subsample

__all__ = ["INITIALIZERS", "Initializer", "initial_groups"]

Initializer = Callable[[PointClouds, Sequence[int], int, torch.Generator], Tensor | Groups]
"""(clouds, num_components (B,), initialisation number, generator) -> means (B, K, D), or groups with weights and
covariances as well, in normalised coordinates. Slots from num_components[b] on are ignored."""

_SEEDING_SAMPLE = 2048


def initial_groups(
    name: str, clouds: PointClouds, num_components: Sequence[int], seed: int, initialization: int
) -> Tensor | Groups:
    """Run the initialiser of this name for K slots, the largest of `num_components` (B,).

    Raises:
        ArgumentError: if the name is not registered.
    """
    if name not in INITIALIZERS:
        raise ArgumentError(f"unknown initializer {name!r}; choose one of {', '.join(sorted(INITIALIZERS))}")
    generator = torch.Generator().manual_seed((seed << 16) + initialization)
    return INITIALIZERS[name](clouds, num_components, initialization, generator)


def evenly_spaced(
    clouds: PointClouds, num_components: Sequence[int], initialization: int, generator: torch.Generator
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
    clouds: PointClouds, num_components: Sequence[int], initialization: int, generator: torch.Generator
) -> Tensor:
    """One point from each of K equal stretches of the scan, so that all are different."""
    slots, sizes, counts = _slots(clouds, num_components)
    jitter = _uniform(slots.numel(), generator).to(clouds.device)
    position = ((slots + jitter) * sizes / counts.clamp_min(1)).long()
    return _points_at(clouds, position)


def kmeans_plus_plus(
    clouds: PointClouds, num_components: Sequence[int], initialization: int, generator: torch.Generator
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
        bounds = (share * distance).cumsum(1)
        chosen = torch.searchsorted(bounds, uniform[k] * bounds[:, -1:], right=True)
        chosen = torch.minimum(chosen, (mask.sum(1, keepdim=True) - 1).clamp_min(0))
        mean = torch.take_along_dim(points, chosen[..., None], 1)  # (B, 1, D)
        to_mean = (points - mean).square().sum(-1)
        distance = to_mean if k == 0 else torch.minimum(distance, to_mean)
        means.append(mean)
    return torch.cat(means, 1)


def merged(
    clouds: PointClouds, num_components: Sequence[int], initialization: int, generator: torch.Generator
) -> Tensor | Groups:
    """Groups of a fine partition joined by eq. 7, see `gmmtorch.hierarchy`.

    There is one such start; initialisations after the first are those of `kmeans++`.
    """
    if initialization > 0:
        return kmeans_plus_plus(clouds, num_components, initialization, generator)
    return merged_groups(clouds, num_components)


INITIALIZERS: dict[str, Initializer] = {
    "evenly_spaced": evenly_spaced,
    "random_points": random_points,
    "kmeans++": kmeans_plus_plus,
    "merged": merged,
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


def _uniform(count: int, generator: torch.Generator) -> Tensor:
    """`count` numbers in [0, 1) whose first ones do not depend on `count`."""
    block = 4096
    blocks = [torch.rand(block, dtype=torch.float64, generator=generator) for _ in range(-(-count // block))]
    return torch.cat(blocks)[:count]
