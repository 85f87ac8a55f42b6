"""Incremental estimation: refine stored mixtures with new scans, without the points they were fitted to.

What EM needs to know of points is their number, mean and covariance (the sufficient statistics), and these can be
kept: component k of a mixture that stands for N points is a *cell* of weight N pi_k, mean mu_k and spread S_k. An
update fits the new points and these K cells together:

1. the old knowledge fades: every cell's weight is multiplied by `forgetting` (exponential forgetting);
2. the mixture grows where it explains badly: the points for which it is a worse explanation than one Gaussian over the
   whole new scan get components of their own, by an order search on these points alone;
3. the order is searched from there (Algorithm 1): components that the evidence no longer tells apart are merged;
4. with forgetting, a component that fewer points support than it has parameters vanishes.

A cell shares its responsibilities, so an old component can be moved, widened or merged, but not divided any more. Its
spread holds the covariance floor already, which is taken out before EM adds it again, so that nothing thickens.

Example:
    >>> import numpy as np
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
from gmmtorch.em import final_status, fit_em
from gmmtorch.errors import ArgumentError, ShapeError, Status
from gmmtorch.mixture_model import MixtureModel
from gmmtorch.mixtures import GaussianMixtures
from gmmtorch.normalization import normalize
from gmmtorch.problem import Problem, components_from_mixtures, mixtures_from_components, prepare
from gmmtorch.reduction import _search, fit_mdl

__all__ = ["UpdateResult", "update"]


@dataclass(frozen=True, eq=False)
class UpdateResult:
    """Refined models.

    Attributes:
        model: the refined mixtures and what they stand for now; unchanged where the new cloud could not be used.
        mdl: description length of the new points and the old cells together (B,) float64, nats; 0 where unchanged.
        num_seeded: components that were added before the order search (B,) int64.
        num_iterations: M-steps made at all orders (B,) int64.
        status: `Status` of every update (B,) int64; EMPTY or NON_FINITE: the cloud could not be used.
    """

    model: MixtureModel
    mdl: Tensor
    num_seeded: Tensor
    num_iterations: Tensor
    status: Tensor


@torch.no_grad()
def update(
    model: MixtureModel,
    clouds: PointClouds,
    *,
    forgetting: float = 1.0,
    max_components: int | Sequence[int] = 20,
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
        criterion: "mdl" (eq. 6), "bic" or "mml".
        max_iterations: M-steps at most at each order.
        min_std: covariance floor as a standard deviation, m.
        relative_floor: covariance floor in units of the extent of model and cloud together.

    Raises:
        ArgumentError: if an option is out of range.
        ShapeError: if there is not one cloud per mixture.
    """
    most = _checked(model, clouds, forgetting, max_components)
    whole = fit_em(
        clouds, 1, min_std=min_std, relative_floor=relative_floor
    )  # what an explanation has to beat
    usable = torch.tensor([Status(s).has_mixture for s in whole.status.tolist()], device=clouds.device)  # type: ignore[call-arg]
    unexplained = _unexplained(model, clouds, whole.mixtures, usable)
    seeds = fit_mdl(
        unexplained, most, criterion=criterion, max_iterations=max_iterations, min_std=min_std,
        relative_floor=relative_floor,
    ).mixtures  # fmt: skip
    points = _keep(clouds, usable[clouds.cloud_index])
    cells = _cells(model, forgetting)
    floor = normalize(_join(cells, points), min_std, relative_floor)
    evidence = _join(_thinned(cells, (floor.floor * floor.scale).square()), points)
    problem = prepare(evidence, min_std, relative_floor, "model", "mdl")
    start = _grown(problem, model, seeds, unexplained.total_weights)
    orders = start.num_components.tolist()
    found = _search(problem, start, orders, _at_most(most, criterion), max_iterations, False)
    refined = mixtures_from_components(problem, found.best.components)
    if forgetting < 1.0:
        refined = _supported(refined, evidence.total_weights)
    status = final_status(problem, found.best, problem.normalized.status, True)
    return UpdateResult(
        model=_choose(usable, MixtureModel(refined, evidence.total_weights), model),
        mdl=torch.where(usable, found.mdl, 0.0),
        num_seeded=torch.where(usable, seeds.num_components, 0),
        num_iterations=torch.where(usable, found.num_iterations, 0),
        status=torch.where(usable, status, whole.status),
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


def _unexplained(
    model: MixtureModel, clouds: PointClouds, whole: GaussianMixtures, usable: Tensor
) -> PointClouds:
    """Points that the mixture explains worse than one Gaussian over the whole scan does.

    None where they are fewer than a component has parameters, unless nothing is known yet.
    """
    worse = model.mixtures.log_prob(clouds) < whole.log_prob(clouds)
    worse = worse & usable[clouds.cloud_index] & (clouds.weights > 0)
    found = torch.stack([w.sum() for w in clouds.split(torch.where(worse, clouds.weights, 0.0))])
    enough = (found >= linalg.num_lifted(clouds.dim)) | (model.mixtures.num_components == 0)
    return _keep(clouds, worse & enough[clouds.cloud_index])


def _cells(model: MixtureModel, forgetting: float) -> PointClouds:
    """The mixtures as clouds of cells: weights forgetting N pi_k, means mu_k, spreads S_k."""
    mixtures, present = model.mixtures, model.mixtures.mask
    weights = forgetting * model.total_weights[:, None] * mixtures.weights
    return PointClouds(
        points=mixtures.means[present],
        weights=weights[present],
        spreads=mixtures.covariances[present],
        offsets=(0, *accumulate(mixtures.num_components.tolist())),
    )


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


def _thinned(cells: PointClouds, variance: Tensor) -> PointClouds:
    """Take the variance of the covariance floor (B,), which EM is going to add, out of the cells' spreads."""
    assert cells.spreads is not None
    values, vectors = torch.linalg.eigh(cells.spreads)
    values = (values - variance[cells.cloud_index, None]).clamp_min(0.0)
    spreads = (vectors * values[:, None]) @ vectors.transpose(1, 2)
    return replace(cells, spreads=0.5 * (spreads + spreads.transpose(1, 2)))


def _grown(problem: Problem, model: MixtureModel, seeds: GaussianMixtures, unexplained: Tensor) -> Components:
    """The mixtures and their seeds, each side weighted by what it has to explain; `unexplained` (B,) by the first."""
    total = problem.normalized.clouds.total_weights
    share = (unexplained / torch.where(total > 0, total, 1.0))[:, None]  # (B, 1)
    old, new = components_from_mixtures(problem, model.mixtures), components_from_mixtures(problem, seeds)
    grown = Components(
        weights=torch.cat([(1.0 - share) * old.weights, share * new.weights], 1),
        means=torch.cat([old.means, new.means], 1),
        covariances=torch.cat([old.covariances, new.covariances], 1),
        factors=torch.cat([old.factors, new.factors], 1),
    )
    return grown.compact(max(1, int(grown.num_components.max())))


def _at_most(max_components: Sequence[int], criterion: str) -> Criterion:
    """Return the criterion, infinite for mixtures of more components than allowed (B,)."""
    plain = criterion_named(criterion)

    def limited(log_likelihood: Tensor, weights: Tensor, total: Tensor, dim: int) -> Tensor:
        most = torch.tensor(max_components, device=weights.device)
        allowed = (weights > 0).sum(-1) <= most
        return torch.where(allowed, plain(log_likelihood, weights, total, dim), torch.inf)

    return limited


def _supported(mixtures: GaussianMixtures, total: Tensor) -> GaussianMixtures:
    """Drop components that fewer points support than they have parameters; the heaviest always stays.

    Args:
        mixtures: the mixtures.
        total: N (B,).
    """
    support = total[:, None] * mixtures.weights
    heaviest = mixtures.weights == mixtures.weights.amax(1, keepdim=True)
    stays = mixtures.mask & ((support >= linalg.num_lifted(mixtures.dim)) | heaviest)
    kept = Components.create(torch.where(stays, mixtures.weights, 0.0), mixtures.means, mixtures.covariances)
    kept = kept.compact(mixtures.num_slots)
    return GaussianMixtures(kept.weights, kept.means, kept.covariances, kept.num_components)


def _choose(usable: Tensor, new: MixtureModel, old: MixtureModel) -> MixtureModel:
    """The new models where the cloud could be used (B,) bool, the old ones elsewhere."""
    slots = max(new.mixtures.num_slots, old.mixtures.num_slots)
    a, b = new.mixtures.pad(slots), old.mixtures.pad(slots)

    def pick(mine: Tensor, theirs: Tensor) -> Tensor:
        return torch.where(usable.reshape(usable.shape + (1,) * (mine.ndim - 1)), mine, theirs)

    mixtures = GaussianMixtures(
        weights=pick(a.weights, b.weights),
        means=pick(a.means, b.means),
        covariances=pick(a.covariances, b.covariances),
        num_components=pick(a.num_components, b.num_components),
    )
    return MixtureModel(mixtures.trim(), pick(new.total_weights, old.total_weights))
