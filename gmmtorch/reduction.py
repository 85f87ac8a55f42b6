"""The order search of Algorithm 1: from K_max components down to one, for a whole batch in step.

Each round fits by EM, values the mixture by the criterion, and joins the two components whose union costs least. Every
order is visited and the best one kept; ties keep the larger order. A cloud whose K_max is smaller than the others'
waits until the round of its order, so that the component axis is as long as the round's order and no longer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from gmmtorch.clouds import PointClouds
from gmmtorch.components import Components
from gmmtorch.criteria import Criterion, criterion_named
from gmmtorch.em import EMState, final_status, run_em
from gmmtorch.errors import ArgumentError, Status
from gmmtorch.merging import merge_closest_pair
from gmmtorch.mixtures import GaussianMixtures
from gmmtorch.problem import (
    Coarsening,
    CovarianceFloor,
    Problem,
    Workload,
    best_start,
    feasible_components,
    mixtures_from_components,
    prepare,
    several_starts,
)

__all__ = ["FitResult", "OrderSearch", "description_length", "fit_mdl", "search_orders"]

_FINER = 4
"""Points that a coarse search's mixture meets before it meets all: so many times those it was found on."""


@dataclass(frozen=True)
class FitResult:
    """Mixtures whose order was chosen.

    Attributes:
        mixtures: the best mixture of every cloud.
        mdl: its description length (B,) float64, nats, in the caller's units; 0 for a cloud without a mixture.
        mdl_path: description length at every order k in column k - 1 (B, K_max), NaN where k was not reached.
        log_likelihood: total weighted log-likelihood of the best mixture (B,), nats.
        status: `Status` of every cloud (B,) int64.
        num_iterations: M-steps made in all rounds of the best initialisation (B,) int64.
        path: mixtures of every order, `path[k - 1]`, empty where k was not reached; None unless asked for.
    """

    mixtures: GaussianMixtures
    mdl: Tensor
    mdl_path: Tensor
    log_likelihood: Tensor
    status: Tensor
    num_iterations: Tensor
    path: tuple[GaussianMixtures, ...] | None = None

    def select(self, indices: Sequence[int]) -> FitResult:
        """Return the fits of these clouds, in this order; an index may repeat."""
        rows = torch.tensor(list(indices), dtype=torch.long, device=self.mdl.device)
        return FitResult(
            mixtures=self.mixtures.select(indices),
            mdl=self.mdl[rows],
            mdl_path=self.mdl_path[rows],
            log_likelihood=self.log_likelihood[rows],
            status=self.status[rows],
            num_iterations=self.num_iterations[rows],
            path=None if self.path is None else tuple(mixtures.select(indices) for mixtures in self.path),
        )


@dataclass
class OrderSearch:
    """What the rounds have found: mixtures in normalised coordinates, lengths in the caller's units."""

    best: EMState
    mdl: Tensor  # (B,)
    mdl_path: Tensor  # (B, K_max)
    num_iterations: Tensor  # (B,)
    path: list[Components]

    def take(self, rows: Tensor) -> OrderSearch:
        """What was found for these (B',) int64."""
        path = [c.take(rows) for c in self.path]
        return OrderSearch(
            self.best.take(rows), self.mdl[rows], self.mdl_path[rows], self.num_iterations[rows], path
        )


@torch.no_grad()
def fit_mdl(
    clouds: PointClouds,
    max_components: int | Sequence[int] = 20,
    *,
    seed: int | Sequence[int] = 0,
    n_init: int = 1,
    initializer: str = "evenly_spaced",
    initial: GaussianMixtures | None = None,
    criterion: str = "mdl",
    max_iterations: int = 100,
    min_std: float | None = None,
    relative_floor: float = 1e-4,
    covariance_floor: CovarianceFloor = "model",
    accelerate: bool = True,
    coarse: int | None = None,
    coarse_by: Coarsening = "points",
    members: Sequence[int] | None = None,
    return_path: bool = False,
) -> FitResult:
    """Fit a mixture to every cloud and choose its order (Algorithm 1).

    Args:
        clouds: the batch.
        max_components: K_max, one number or one per fit.
        seed: of the random initialisers, one for all fits or one per fit.
        n_init: initialisations of every fit, run as one batch; the shortest description is kept.
        initializer: name of an initialiser of `gmmtorch.INITIALIZERS`.
        initial: mixtures to start from, one per fit, in the caller's units, of at most K_max components; the others are
            seeded where they explain the cloud worst (initialiser `from_mixtures`).
        criterion: "mdl" (eq. 6), "bic", or "mml" (Figueiredo & Jain 2002).
        max_iterations: M-steps at most at each order; EM stops before when it gains at most
            0.01 (1 + D + D (D + 1) / 2) log(N D) nats.
        min_std: covariance floor as a standard deviation, m.
        relative_floor: covariance floor in units of the cloud's robust extent.
        covariance_floor: "model" or "paper", as in `fit_em`.
        accelerate: over-relaxed EM, as in `fit_em`; False makes EM's own steps only, as the paper.
        coarse: search the order on so many times fewer points, then polish the best mixture by EM on a quarter of that
            thinning and on all points. The path keeps the lengths on the fewer points, but for the order chosen.
        coarse_by: what those are: "points", one of so many (`gmmtorch.coarsening.thin`), or "cells" of at most so many
            points (`coarsen`), whose bound prefers smaller orders.
        members: cloud of every fit (B',), for several fits of a cloud, with other K_max, that share its points;
            by default every cloud is fitted once.
        return_path: also return the mixtures of all orders.

    Raises:
        ArgumentError: if an option is out of range.
        ShapeError: if `max_components` does not fit the batch.
    """
    if max_iterations < 1 or n_init < 1:
        raise ArgumentError(f"max_iterations and n_init must be >= 1, got {max_iterations} and {n_init}")
    if initial is not None:
        initializer = "from_mixtures"
    value = criterion_named(criterion)
    problem = prepare(clouds, min_std, relative_floor, covariance_floor, "mdl", accelerate)
    levels = [problem]  # from few points to all
    if coarse is not None:
        steps = [coarse, coarse // _FINER] if coarse > _FINER else [coarse]
        levels = [*(problem.coarsened(step, coarse_by) for step in steps), problem]
    if members is not None:
        levels = [level.take(members) for level in levels]
    searched, problem = levels[0], levels[-1]
    held, before = feasible_components(searched, max_components)
    starts = several_starts(problem, held, initializer, seed, n_init, initial)
    workload = searched.workload.take(list(range(len(held))) * n_init)
    found = search_orders(workload, starts, held * n_init, value, max_iterations, return_path)
    found = found.take(best_start(found.mdl, n_init))
    if coarse is not None:
        found = _polished([level.workload for level in levels[1:]], found, value, max_iterations)
    longest = max_components if isinstance(max_components, int) else max(max_components)
    return _result(problem, found, before, longest)


@torch.no_grad()
def description_length(mixtures: GaussianMixtures, clouds: PointClouds, criterion: str = "mdl") -> Tensor:
    """Description length of given mixtures (B,), nats: eq. 6, or another criterion; 0 for an empty mixture."""
    per_point = clouds.split(mixtures.log_prob(clouds) * clouds.weights)
    log_likelihood = torch.stack([v.sum() for v in per_point])
    value = criterion_named(criterion)(log_likelihood, mixtures.weights, clouds.total_weights, clouds.dim)
    return torch.where(mixtures.num_components > 0, value, 0.0)


def search_orders(
    workload: Workload,
    start: Components,
    orders: Sequence[int],
    criterion: Criterion,
    max_iterations: int,
    keep_path: bool,
) -> OrderSearch:
    """Algorithm 1 from given components, for clouds that start with `orders` (B,) of them."""
    total, dim, slots = workload.total, start.means.shape[-1], start.weights.shape[1]
    found = OrderSearch(
        best=EMState.start(start),
        mdl=torch.full_like(total, torch.inf),
        mdl_path=total.new_full((len(orders), slots), torch.nan),
        num_iterations=torch.zeros_like(total, dtype=torch.int64),
        path=[start.absent()] * slots if keep_path else [],
    )
    orders, valued, components = list(orders), [False] * len(orders), start
    for order in range(slots, 0, -1):
        # EM_algorithm(k, Y, theta): lines 3 and 10
        members = [b for b, k in enumerate(orders) if k == order and not valued[b]]
        if members:
            state = run_em(workload, components, max_iterations, members)
            components = state.components
            orders = components.num_components.tolist()
            mdl = criterion(state.log_likelihood - workload.volume, components.weights, total, dim)
            _record(found, state, mdl, members, orders)
            valued = [v or b in members for b, v in enumerate(valued)]
        # Resize(theta): lines 8 and 9; a cloud that lost components on the way waits for the round of its order
        shrinking = [k == order > 1 and v for k, v in zip(orders, valued, strict=True)]
        if order > 1:
            mask = torch.tensor(shrinking, device=total.device)
            components = merge_closest_pair(components, total, mask)
            components = components.compact(_slots(order - 1, components))
            orders = [k - s for k, s in zip(orders, shrinking, strict=True)]
            valued = [v and not s for v, s in zip(valued, shrinking, strict=True)]
    return found


def _slots(order: int, components: Components) -> int:
    """Slots for mixtures of so many components; on a device in steps of 8, so that a graph serves several orders."""
    if components.weights.device.type == "cpu":
        return order
    return min(components.weights.shape[1], -(-order // 8) * 8)


def _record(
    found: OrderSearch, state: EMState, mdl: Tensor, members: Sequence[int], orders: Sequence[int]
) -> None:
    """Note the description lengths of a round, and keep the best mixtures (lines 12-16)."""
    slots = found.mdl_path.shape[1]
    fitted = torch.tensor([b in members for b in range(len(orders))], device=mdl.device)
    fitted &= torch.tensor([k > 0 for k in orders], device=mdl.device)
    column = torch.tensor(orders, device=mdl.device)[:, None] - 1
    here = (torch.arange(slots, device=mdl.device) == column) & fitted[:, None]
    found.mdl_path = torch.where(here, mdl[:, None], found.mdl_path)
    found.num_iterations = found.num_iterations + torch.where(fitted, state.num_iterations, 0)
    components = state.components.pad(slots)
    found.path = [components.where(here[:, k], kept) for k, kept in enumerate(found.path)]
    better = fitted & (mdl < found.mdl)
    found.best = EMState(components, *state.per_cloud()).where(better, found.best)
    found.mdl = torch.where(better, mdl, found.mdl)


def _polished(
    levels: Sequence[Workload], found: OrderSearch, criterion: Criterion, max_iterations: int
) -> OrderSearch:
    """The best mixtures after EM on ever more points; the last level is all of them."""
    workload, components, num_iterations = levels[-1], found.best.components, found.num_iterations
    for level in levels:
        state = run_em(level, components, max_iterations)
        components, num_iterations = state.components, num_iterations + state.num_iterations
    dim = components.means.shape[-1]
    mdl = criterion(state.log_likelihood - workload.volume, components.weights, workload.total, dim)
    mdl = torch.where(found.mdl.isfinite(), mdl, found.mdl)
    orders = torch.arange(1, found.mdl_path.shape[1] + 1, device=mdl.device)
    chosen = orders == found.best.components.num_components[:, None]
    return OrderSearch(
        best=state,
        mdl=mdl,
        mdl_path=torch.where(chosen, mdl[:, None], found.mdl_path),
        num_iterations=num_iterations,
        path=[components.where(chosen[:, k], kept) for k, kept in enumerate(found.path)],
    )


def _result(problem: Problem, found: OrderSearch, before: Sequence[Status], longest: int) -> FitResult:
    """Bring what was found back to the caller's units."""
    fitted = found.mdl.isfinite()
    missing = longest - found.mdl_path.shape[1]
    path = None
    if found.path:
        reached = [mixtures_from_components(problem, c) for c in found.path]
        path = (*reached, *[mixtures_from_components(problem, found.path[0].absent())] * missing)
    return FitResult(
        mixtures=mixtures_from_components(problem, found.best.components).trim(),
        mdl=torch.where(fitted, found.mdl, 0.0),
        mdl_path=torch.nn.functional.pad(found.mdl_path, (0, missing), value=torch.nan),
        log_likelihood=torch.where(fitted, found.best.log_likelihood - problem.workload.volume, 0.0),
        status=final_status(problem, found.best, before, True),
        num_iterations=found.num_iterations,
        path=path,
    )
