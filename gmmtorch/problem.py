"""A batch prepared for EM: everything that stays the same while the mixtures change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.clouds import PointClouds
from gmmtorch.coarsening import coarsen, thin
from gmmtorch.components import Components
from gmmtorch.errors import ArgumentError, ShapeError, Status
from gmmtorch.graphs import Stepper
from gmmtorch.hierarchy import Groups
from gmmtorch.initializers import initial_groups
from gmmtorch.mixtures import GaussianMixtures
from gmmtorch.normalization import NormalizedClouds, normalize
from gmmtorch.statistics import total_covariance
from gmmtorch.tiles import Tiles

__all__ = [
    "Coarsening",
    "CovarianceFloor",
    "Problem",
    "Tolerance",
    "Workload",
    "best_start",
    "components_from_mixtures",
    "feasible_components",
    "initial_components",
    "mixtures_from_components",
    "prepare",
    "several_starts",
]

CovarianceFloor = Literal["model", "paper"]
Coarsening = Literal["points", "cells"]
Tolerance = float | Literal["mdl"] | None

_STARVED = 1e-6  # of the mean point weight: below it a component explains nothing and is dropped
_PAPER_FLOOR = 1e-5  # of the mean variance, Bouman's constant
_TINY_FLOOR = 1e-10
_RELAXATION = (
    1.5  # growth of over-relaxed steps; from 1.1 to 2, the number of iterations differs by a few percent
)


@dataclass(frozen=True)
class Workload:
    """What an EM iteration reads.

    Attributes:
        tiles: the points in the layout of the kernel.
        floor: standard deviation of the spread that belongs to every point (B,).
        added: variance that the M-step adds to the covariances (B,): floor^2, but for the paper's floor.
        starved: N_k below which a component is dropped (B,).
        tolerance: gain at which EM stops (B,), nats; None for never.
        total: total weight N (B,).
        volume: nats by which log-likelihoods in the caller's units are below those in normalised ones (B,).
        relaxation: factor by which the M-steps grow while they succeed; 1 for EM's own steps.
        steppers: on a device, what makes the iterations for a number of slots K.
    """

    tiles: Tiles
    floor: Tensor
    added: Tensor
    starved: Tensor
    tolerance: Tensor | None
    total: Tensor
    volume: Tensor
    relaxation: float
    steppers: dict[int, Stepper] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def in_double(self) -> Workload:
        """The same work for arithmetic in float64."""
        return replace(self, tiles=self.tiles.in_double)

    def take(self, clouds: Sequence[int]) -> Workload:
        """The part that belongs to these clouds (B',), known on the host; a cloud may repeat."""
        if list(clouds) == list(range(self.tiles.batch_size)):
            return self
        rows = torch.tensor(clouds, device=self.floor.device)
        return Workload(
            tiles=self.tiles.take(clouds),
            floor=self.floor[rows],
            added=self.added[rows],
            starved=self.starved[rows],
            tolerance=None if self.tolerance is None else self.tolerance[rows],
            total=self.total[rows],
            volume=self.volume[rows],
            relaxation=self.relaxation,
        )


@dataclass(frozen=True)
class Problem:
    """A normalised batch, its workload, and the covariance of every whole cloud (B, D, D), floor included."""

    normalized: NormalizedClouds
    workload: Workload
    covariance: Tensor

    def take(self, clouds: Sequence[int]) -> Problem:
        """The problem of these clouds (B',); the tiles of a cloud that repeats are shared."""
        rows = torch.tensor([range(len(self.covariance))[b] for b in clouds], device=self.covariance.device)
        normalized = self.normalized.take(rows.tolist())
        return Problem(normalized, self.workload.take(rows.tolist()), self.covariance[rows])

    def coarsened(self, factor: int, by: Coarsening) -> Problem:
        """The same problem with fewer points: one of `factor` (`thin`), or cells of at most so many (`coarsen`)."""
        if by not in ("points", "cells"):
            raise ArgumentError(f"coarse_by must be 'points' or 'cells', got {by!r}")
        fewer = (thin if by == "points" else coarsen)(self.normalized.clouds, factor)
        workload = replace(self.workload, tiles=Tiles.build(fewer))
        return Problem(replace(self.normalized, clouds=fewer), workload, self.covariance)


def prepare(
    clouds: PointClouds,
    min_std: float | None,
    relative_floor: float,
    covariance_floor: CovarianceFloor,
    tolerance: Tolerance,
    accelerate: bool = False,
) -> Problem:
    """Normalise, sort and tile a batch; synchronises the device.

    Raises:
        ArgumentError: if an option is out of range.
    """
    if covariance_floor not in ("model", "paper"):
        raise ArgumentError(f"covariance_floor must be 'model' or 'paper', got {covariance_floor!r}")
    if not relative_floor >= 0 or (min_std is not None and not min_std >= 0):
        raise ArgumentError(f"relative_floor and min_std must be >= 0, got {relative_floor} and {min_std}")
    normalized = normalize(clouds, min_std, relative_floor)
    tiles = Tiles.build(normalized.clouds)
    covariance = total_covariance(tiles)
    floor, added = normalized.floor, normalized.floor.square()
    if covariance_floor == "paper":
        mean_variance = covariance.diagonal(dim1=1, dim2=2).mean(1)
        floor, added = torch.zeros_like(floor), (_PAPER_FLOOR * mean_variance).clamp_min(_TINY_FLOOR**2)
    identity = torch.eye(clouds.dim, dtype=torch.float64, device=clouds.device)
    sizes = torch.tensor(normalized.clouds.sizes, device=clouds.device).clamp_min(1)
    total = normalized.clouds.total_weights
    starved = _STARVED * total / sizes
    workload = Workload(
        tiles=tiles,
        floor=floor,
        added=added,
        starved=starved,
        tolerance=_tolerances(normalized.clouds, tolerance),
        total=total,
        volume=total * normalized.log_volume,
        relaxation=_RELAXATION if accelerate else 1.0,
    )
    return Problem(normalized, workload, covariance + added[:, None, None] * identity)


def components_from_mixtures(problem: Problem, mixtures: GaussianMixtures) -> Components:
    """Mixtures of the caller in normalised coordinates.

    Raises:
        ShapeError: if there is not one mixture per cloud.
    """
    normalized = problem.normalized
    if mixtures.batch_size != normalized.clouds.batch_size or mixtures.dim != normalized.clouds.dim:
        raise ShapeError(
            f"expected {normalized.clouds.batch_size} mixtures of {normalized.clouds.dim} coordinates, one per "
            f"cloud, got {mixtures.batch_size} of {mixtures.dim}"
        )
    scale = normalized.scale[:, None, None]
    means = (mixtures.means - normalized.center[:, None]) / scale
    return Components.create(mixtures.weights, means, mixtures.covariances / scale[..., None].square())


def mixtures_from_components(problem: Problem, components: Components) -> GaussianMixtures:
    """Components in the caller's units, those present first; none for clouds without points."""
    packed = components.compact(components.weights.shape[1])
    scale, center = problem.normalized.scale[:, None, None], problem.normalized.center[:, None]
    has_points = torch.tensor(problem.normalized.clouds.sizes, device=scale.device) > 0
    present = (packed.weights > 0) & has_points[:, None]
    identity = torch.eye(center.shape[-1], dtype=center.dtype, device=center.device)
    covariances = packed.covariances * scale[..., None].square()
    return GaussianMixtures(
        weights=torch.where(present, packed.weights, 0.0),
        means=torch.where(present[..., None], packed.means * scale + center, 0.0),
        covariances=torch.where(present[..., None, None], covariances, identity),
        num_components=present.sum(1),
    )


def feasible_components(
    problem: Problem, num_components: int | Sequence[int]
) -> tuple[list[int], tuple[Status, ...]]:
    """Components that each cloud can hold (B,), at most one per point, and what was in the way."""
    sizes, status = problem.normalized.clouds.sizes, problem.normalized.status
    wanted = (
        [num_components] * len(sizes) if isinstance(num_components, int) else [int(k) for k in num_components]
    )
    if len(wanted) != len(sizes):
        raise ShapeError(
            f"expected one number of components or {len(sizes)}, one per cloud, got {len(wanted)}"
        )
    if min(wanted) < 1:
        raise ArgumentError(f"every cloud needs at least 1 component, got {min(wanted)}")
    held = [
        1 if s is Status.IDENTICAL_POINTS else min(k, n)
        for k, n, s in zip(wanted, sizes, status, strict=True)
    ]
    outcome = tuple(
        Status.FEWER_POINTS_THAN_COMPONENTS if s is Status.OK and h < k else s
        for s, h, k in zip(status, held, wanted, strict=True)
    )
    return held, outcome


def several_starts(
    problem: Problem,
    num_components: Sequence[int],
    initializer: str,
    seed: int | Sequence[int],
    n_init: int,
    initial: GaussianMixtures | None = None,
) -> Components:
    """Several initialisations of every fit, as a longer batch (n_init B,): all first ones, then all second ones.

    Args:
        problem: the batch.
        num_components: K of every fit (B,).
        initializer: name of an initialiser.
        seed: one for all fits, or one per fit (B,).
        n_init: initialisations of every fit.
        initial: mixtures that the initialiser `from_mixtures` begins with (B,).
    """
    seeds = [seed] * len(num_components) if isinstance(seed, int) else list(seed)
    if len(seeds) != len(num_components):
        raise ShapeError(f"expected one seed or {len(num_components)}, one per fit, got {len(seeds)}")
    starts = [
        initial_components(problem, num_components, initializer, seeds[0], i, initial) for i in range(n_init)
    ]
    for other in sorted(set(seeds) - {seeds[0]}):
        rows = [b for b, s in enumerate(seeds) if s == other]
        part, here = problem.take(rows), torch.tensor(rows, device=problem.covariance.device)
        orders, known = [num_components[b] for b in rows], None if initial is None else initial.select(rows)
        for i, start in enumerate(starts):
            fresh = initial_components(part, orders, initializer, other, i, known)
            starts[i] = start.put(here, fresh.pad(start.weights.shape[1]))
    return Components.concatenate(starts)


def best_start(value: Tensor, n_init: int) -> Tensor:
    """Place of the least value among the initialisations of every cloud, the first of equals: (n_init B,) -> (B,)."""
    per_start = value.unflatten(0, (n_init, -1))
    first = (per_start == per_start.amin(0)).int().argmax(0)
    return first * per_start.shape[1] + torch.arange(per_start.shape[1], device=value.device)


def initial_components(
    problem: Problem,
    num_components: Sequence[int],
    initializer: str,
    seed: int,
    initialization: int,
    initial: GaussianMixtures | None = None,
) -> Components:
    """What the initialiser gives; where it gives means only, equal weights and the covariance of the whole cloud."""
    clouds = problem.normalized.clouds
    slots = max(1, *num_components)
    counts = torch.tensor(num_components, device=clouds.device)[:, None]
    present = torch.arange(slots, device=clouds.device) < counts
    if max(num_components) == 0:
        return Components.create(present.double(), *_nowhere(problem, slots))
    identity = torch.eye(clouds.dim, dtype=torch.float64, device=clouds.device)
    floor = problem.workload.added[:, None, None, None] * identity
    known = None
    if initial is not None:
        given = components_from_mixtures(problem, initial)
        known = Groups(given.weights, given.means, given.covariances - floor)
    start = initial_groups(initializer, clouds, num_components, seed, initialization, known)
    if isinstance(start, Tensor):
        weights = present / counts.clamp_min(1).double()
        return Components.create(weights, start, problem.covariance[:, None].expand(-1, slots, -1, -1))
    return Components.create(torch.where(present, start.weights, 0.0), start.means, start.covariances + floor)


def _nowhere(problem: Problem, slots: int) -> tuple[Tensor, Tensor]:
    """Means and covariances of slots that no cloud of the batch uses (B, K, D), (B, K, D, D)."""
    covariances = problem.covariance[:, None].expand(-1, slots, -1, -1)
    return covariances.new_zeros(covariances.shape[:3]), covariances


def _tolerances(clouds: PointClouds, tolerance: Tolerance) -> Tensor | None:
    """Gain in nats at which EM stops (B,); None for never."""
    if tolerance is None:
        return None
    total = clouds.total_weights
    if tolerance == "mdl":
        return 0.01 * linalg.num_lifted(clouds.dim) * (total * clouds.dim).clamp_min(1.0).log()
    if not isinstance(tolerance, int | float) or math.isnan(tolerance):
        raise ArgumentError(f"tolerance must be a number of nats, 'mdl' or None, got {tolerance!r}")
    return torch.full_like(total, float(tolerance))
