"""Incremental estimation: refine stored mixtures with new scans, without the points they were fitted to.

What EM needs to know of points is their number, mean and covariance, patch by patch, and such *cells* can be kept and
merged (sufficient statistics). A `MixtureModel` is a mixture with a few hundred cells. An update

1. lets the old knowledge fade: every cell's weight is multiplied by `forgetting` (exponential forgetting);
2. joins the old cells and the new points, which is all the evidence there is;
3. proposes components wherever the evidence asks for them, by an order search that does not know the old mixture;
4. searches the order once more from the old components and the proposed ones together (Algorithm 1): those that say
   the same are merged, those that explain what nothing else does remain, and no good component is lost;
5. with forgetting, drops components that fewer points support than they have parameters;
6. merges the evidence into cells again.

Example:
    >>> import numpy as np
    >>> from gmmtorch import fit_mdl
    >>> rng = np.random.default_rng(0)
    >>> wall = [rng.normal(0.0, [1.0, 0.01, 0.5], (400, 3)) for _ in range(2)]
    >>> box = rng.normal([0.0, 2.0, 0.0], 0.1, (200, 3))
    >>> before = PointClouds.from_list([wall[0]])
    >>> model = MixtureModel.of(fit_mdl(before).mixtures, before)
    >>> after = update(model, PointClouds.from_list([np.concatenate([wall[1], box])])).model
    >>> (after.mixtures.num_components - model.mixtures.num_components).tolist(), after.total_weights.tolist()
    ([1], [1000.0])
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.clouds import PointClouds
from gmmtorch.components import Components
from gmmtorch.criteria import Criterion, criterion_named
from gmmtorch.em import final_status
from gmmtorch.errors import ArgumentError, ShapeError
from gmmtorch.mixture_model import NUM_CELLS, MixtureModel
from gmmtorch.mixtures import GaussianMixtures
from gmmtorch.normalization import normalize
from gmmtorch.problem import (
    Problem,
    components_from_mixtures,
    feasible_components,
    initial_components,
    mixtures_from_components,
    prepare,
)
from gmmtorch.reduction import OrderSearch, search_orders

__all__ = ["UpdateResult", "update"]


@dataclass(frozen=True, eq=False)
class UpdateResult:
    """Refined models.

    Attributes:
        model: the refined mixtures and what they stand for; the very same where the new cloud could not be used.
        mdl: description length of the new points and the old cells together (B,) float64, nats, before components
            without support were dropped; 0 where unchanged.
        num_iterations: M-steps made at all orders of the last search (B,) int64.
        status: `Status` of every update (B,) int64; EMPTY or NON_FINITE: the cloud could not be used.
    """

    model: MixtureModel
    mdl: Tensor
    num_iterations: Tensor
    status: Tensor


@torch.no_grad()
def update(
    model: MixtureModel,
    clouds: PointClouds,
    *,
    forgetting: float = 1.0,
    max_components: int | Sequence[int] = 20,
    num_cells: int = NUM_CELLS,
    seed: int = 0,
    criterion: str = "mdl",
    max_iterations: int = 100,
    min_std: float | None = None,
    relative_floor: float = 1e-4,
) -> UpdateResult:
    """Refine every mixture with a new scan of the same place.

    Args:
        model: what is known so far: `MixtureModel.of(fit.mixtures, clouds)`, or the model of an earlier update.
        clouds: one new cloud per mixture, in the same frame, m.
        forgetting: factor in (0, 1] on the weight of what is known; 1 forgets nothing.
        max_components: K_max of the refined mixtures, one number or one per cloud.
        num_cells: about how many cells to keep of every cloud.
        seed: of the initial means of the proposed components.
        criterion: "mdl" (eq. 6), "bic" or "mml".
        max_iterations: M-steps at most at each order.
        min_std: covariance floor as a standard deviation, m.
        relative_floor: covariance floor in units of the extent of model and cloud together.

    Raises:
        ArgumentError: if an option is out of range.
        ShapeError: if there is not one cloud per mixture.
    """
    most = _checked(model, clouds, forgetting, max_components)
    scanned = normalize(clouds, min_std, relative_floor).status
    usable = torch.tensor([status.has_mixture for status in scanned], device=clouds.device)
    evidence = _join(_faded(model.cells, forgetting), _keep(clouds, usable[clouds.cloud_index]))
    problem = prepare(evidence, min_std, relative_floor, "model", "mdl", accelerate=True)
    found = _grown_and_merged(problem, model.mixtures, most, criterion, max_iterations, seed)
    refined = MixtureModel.of(mixtures_from_components(problem, found.best.components), evidence, num_cells)
    if forgetting < 1.0:
        refined = _supported(refined)
    unusable = torch.tensor([int(status) for status in scanned], device=clouds.device)
    status = final_status(problem, found.best, problem.normalized.status, True)
    return UpdateResult(
        model=_choose(usable, refined, model),
        mdl=torch.where(usable, found.mdl, 0.0),
        num_iterations=torch.where(usable, found.num_iterations, 0),
        status=torch.where(usable, status, unusable),
    )


def _checked(
    model: MixtureModel, clouds: PointClouds, forgetting: float, max_components: int | Sequence[int]
) -> list[int]:
    """Check the arguments that only an update has; K_max of every cloud (B,)."""
    mixtures = model.mixtures
    if clouds.batch_size != model.batch_size or clouds.dim != mixtures.dim:
        raise ShapeError(
            f"expected {model.batch_size} clouds of {mixtures.dim} coordinates, one per mixture, got "
            f"{clouds.batch_size} of {clouds.dim}; use an empty cloud where there is no new scan"
        )
    if not 0.0 < forgetting <= 1.0:
        raise ArgumentError(f"forgetting must be in (0, 1], where 1 forgets nothing, got {forgetting}")
    if isinstance(max_components, int):
        return [max_components] * clouds.batch_size
    return [int(k) for k in max_components]


def _faded(cells: PointClouds, forgetting: float) -> PointClouds:
    """The cells with what is left of their weights."""
    return replace(cells, weights=forgetting * cells.weights)


def _keep(clouds: PointClouds, mask: Tensor) -> PointClouds:
    """The points (N,) bool of every cloud that the mask holds."""
    spreads = None if clouds.spreads is None else clouds.spreads[mask]
    sizes = torch.stack([kept.sum() for kept in clouds.split(mask)]).tolist()
    return PointClouds(
        clouds.points[mask], clouds.weights[mask], spreads, (0, *accumulate(sizes)), clouds.dtype
    )


def _join(first: PointClouds, second: PointClouds) -> PointClouds:
    """Every cloud of the first batch followed by that of the second, with the second's precision."""
    both = PointClouds.concatenate([first, second])
    size = first.batch_size
    order = [b + half * size for b in range(size) for half in range(2)]
    mixed = both.select(order)
    return PointClouds(mixed.points, mixed.weights, mixed.spreads, mixed.offsets[::2], second.dtype)


def _grown_and_merged(
    problem: Problem,
    mixtures: GaussianMixtures,
    max_components: Sequence[int],
    criterion: str,
    max_iterations: int,
    seed: int,
) -> OrderSearch:
    """Search the order from the old components and from those that a search without them proposes, together."""
    limited = _at_most(max_components, criterion)
    held, _ = feasible_components(problem, max_components)
    start = initial_components(problem, held, "kmeans++", seed, 0)
    proposed = search_orders(problem.workload, start, held, limited, max_iterations, False).best.components
    old = components_from_mixtures(problem, mixtures)
    both = Components(
        weights=_normalized(torch.cat([mixtures.weights, proposed.weights], 1)),
        means=torch.cat([old.means, proposed.means], 1),
        covariances=torch.cat([old.covariances, proposed.covariances], 1),
        factors=torch.cat([old.factors, proposed.factors], 1),
    )
    orders = both.num_components.tolist()
    both = both.compact(max(1, *orders))
    return search_orders(problem.workload, both, orders, limited, max_iterations, False)


def _at_most(max_components: Sequence[int], criterion: str) -> Criterion:
    """Return the criterion, infinite for mixtures of more components than allowed (B,)."""
    plain = criterion_named(criterion)

    def limited(log_likelihood: Tensor, weights: Tensor, total: Tensor, dim: int) -> Tensor:
        most = torch.tensor(max_components, device=weights.device)
        allowed = (weights > 0).sum(-1) <= most
        return torch.where(allowed, plain(log_likelihood, weights, total, dim), torch.inf)

    return limited


def _supported(model: MixtureModel) -> MixtureModel:
    """Drop the components that fewer points support than they have parameters, and these points with them.

    Few must be both the component's own weight and the cells that it claims. The heaviest component always stays.
    """
    mixtures, cells = model.mixtures, model.cells
    needed = linalg.num_lifted(mixtures.dim)
    place = cells.cloud_index * mixtures.num_slots + mixtures.assign(cells)
    claimed = torch.bincount(place, cells.weights, minlength=mixtures.mask.numel()).view_as(mixtures.weights)
    support = torch.maximum(claimed, model.total_weights[:, None] * mixtures.weights)
    heaviest = mixtures.weights == mixtures.weights.amax(1, keepdim=True)
    stays = mixtures.mask & ((support >= needed) | heaviest)
    weights = torch.where(stays, mixtures.weights, 0.0)
    kept = Components.create(weights, mixtures.means, mixtures.covariances)
    kept = replace(kept, weights=_normalized(weights)).compact(mixtures.num_slots)
    mixtures = GaussianMixtures(kept.weights, kept.means, kept.covariances, kept.num_components)
    return MixtureModel(mixtures, _keep(cells, stays.flatten()[place]))


def _normalized(weights: Tensor) -> Tensor:
    """Weights (B, K) that sum to 1; the bits do not depend on how much padding the batch needs."""
    total = weights.cumsum(1)[:, -1:]
    return weights / torch.where(total > 0, total, 1.0)


def _choose(usable: Tensor, new: MixtureModel, old: MixtureModel) -> MixtureModel:
    """The new models where the cloud could be used (B,) bool, the old ones elsewhere."""
    slots = max(new.mixtures.num_slots, old.mixtures.num_slots)
    pairs = zip(_padded(new.mixtures, slots), _padded(old.mixtures, slots), strict=True)
    chosen = [torch.where(usable.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs]
    rows = [b if fresh else b + len(usable) for b, fresh in enumerate(usable.tolist())]
    cells = PointClouds.concatenate([new.cells, old.cells]).select(rows)
    return MixtureModel(GaussianMixtures(*chosen).trim(), cells)


def _padded(mixtures: GaussianMixtures, num_slots: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Weights, means and covariances with so many slots, and the numbers of components; changes no bit of them."""
    extra = num_slots - mixtures.num_slots
    identity = torch.eye(mixtures.dim, dtype=mixtures.means.dtype, device=mixtures.means.device)
    return (
        torch.nn.functional.pad(mixtures.weights, (0, extra)),
        torch.nn.functional.pad(mixtures.means, (0, 0, 0, extra)),
        torch.cat([mixtures.covariances, identity.expand(len(mixtures), extra, -1, -1)], 1),
        mixtures.num_components,
    )
