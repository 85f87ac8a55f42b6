"""Expectation maximisation for a batch of clouds, at a fixed number of components."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.clouds import PointClouds
from gmmtorch.components import Components
from gmmtorch.errors import ArgumentError, Status
from gmmtorch.graphs import Stepper
from gmmtorch.mixtures import GaussianMixtures
from gmmtorch.problem import (
    CovarianceFloor,
    Problem,
    Tolerance,
    Workload,
    best_start,
    components_from_mixtures,
    feasible_components,
    mixtures_from_components,
    prepare,
    several_starts,
)
from gmmtorch.statistics import Statistics, expectation, log_likelihood

__all__ = ["EMResult", "EMState", "final_status", "fit_em", "maximization", "run_em"]

ROUND_OFF = 4.0 * torch.finfo(torch.float64).eps  # of the trace: what the moments themselves are uncertain by
_REPACK_BELOW = 0.7  # share of the tiles still running, below which the others are left out
_LOOK_EVERY = 4  # iterations between looks at convergence on a device, where a look is a synchronisation
LONGEST_STEP = 8.0  # of over-relaxed EM; it is rarely reached, and 4 or 20 do as well
LEAST_SHARE = 0.5  # of a component's points that a longer step has to leave it
_AT_FLOOR = 0.5  # of a standard deviation squared that comes from the floor


@dataclass(frozen=True)
class EMResult:
    """Mixtures fitted by EM.

    Attributes:
        mixtures: the mixtures after the last M-step.
        log_likelihood: total weighted log-likelihood of these mixtures (B,) float64, nats, in the caller's units.
        objective: the same for points that have the spread of the covariance floor (B,), nats: what EM maximises.
        num_iterations: M-steps made (B,) int64.
        converged: whether the last gain was at most the tolerance (B,) bool; False when `tolerance` is None.
        status: `Status` of every cloud (B,) int64.
    """

    mixtures: GaussianMixtures
    log_likelihood: Tensor
    objective: Tensor
    num_iterations: Tensor
    converged: Tensor
    status: Tensor


@dataclass(frozen=True)
class EMState:
    """Where EM stands, per cloud; the other fields as in `EMResult`.

    Attributes:
        components: the mixtures, in normalised coordinates.
        gain: objective won by the last step that was kept (B,), nats.
        step: length of the next M-step (B,): 1 is EM's own, more is over-relaxed.
    """

    components: Components
    objective: Tensor
    log_likelihood: Tensor
    gain: Tensor
    num_iterations: Tensor
    converged: Tensor
    step: Tensor

    @staticmethod
    def start(components: Components) -> EMState:
        """State before the first E-step."""
        zero = torch.zeros_like(components.weights[:, 0])
        return EMState(components, zero, zero, zero, zero.long(), zero.bool(), zero + 1.0)

    def per_cloud(self) -> tuple[Tensor, ...]:
        """All fields but the mixtures, each (B,)."""
        return tuple(getattr(self, f.name) for f in fields(self)[1:])

    def take(self, clouds: Tensor) -> EMState:
        """States of these clouds (B',) int64."""
        return EMState(self.components.take(clouds), *(t.index_select(0, clouds) for t in self.per_cloud()))

    def put(self, clouds: Tensor, other: EMState) -> EMState:
        """Replace the states of these clouds (B',) int64 by those of `other`."""
        pairs = zip(self.per_cloud(), other.per_cloud(), strict=True)
        per_cloud = (mine.index_copy(0, clouds, theirs) for mine, theirs in pairs)
        return EMState(self.components.put(clouds, other.components), *per_cloud)

    def where(self, condition: Tensor, other: EMState) -> EMState:
        """Keep these states where the condition (B,) bool holds, those of `other` elsewhere."""
        pairs = zip(self.per_cloud(), other.per_cloud(), strict=True)
        per_cloud = (torch.where(condition, mine, theirs) for mine, theirs in pairs)
        return EMState(self.components.where(condition, other.components), *per_cloud)


@torch.no_grad()
def fit_em(
    clouds: PointClouds,
    num_components: int | Sequence[int] | None = None,
    *,
    initial: GaussianMixtures | None = None,
    max_iterations: int = 100,
    tolerance: Tolerance = "mdl",
    seed: int | Sequence[int] = 0,
    n_init: int = 1,
    initializer: str = "evenly_spaced",
    min_std: float | None = None,
    relative_floor: float = 1e-4,
    covariance_floor: CovarianceFloor = "model",
    accelerate: bool = False,
) -> EMResult:
    """Fit one Gaussian mixture of K components to every cloud.

    Args:
        clouds: the batch.
        num_components: K, one number or one per cloud; not needed with `initial`.
        initial: mixtures to start from, in the caller's units, instead of an initialiser.
        max_iterations: M-steps at most.
        tolerance: EM stops when it gains at most so many nats in total; "mdl" is Bouman's
            0.01 (1 + D + D (D + 1) / 2) log(N D), None makes all iterations.
        seed: of the random initialisers, one for all clouds or one per cloud.
        n_init: initialisations of every cloud, run as one batch; the most likely result is kept.
        initializer: name of an initialiser of `gmmtorch.INITIALIZERS`.
        min_std: covariance floor as a standard deviation, m.
        relative_floor: covariance floor in units of the cloud's robust extent.
        covariance_floor: "model", a spread of every point, so that EM never lowers the objective; or
            "paper", Bouman's 1e-5 mean(diag cov) added by the M-step alone, which may.
        accelerate: lengthen the M-steps while that raises the objective (`extrapolate`): about half as many.

    Raises:
        ArgumentError: if an option is out of range.
        ShapeError: if `initial` or `num_components` does not fit the batch.
    """
    if max_iterations < 0 or n_init < 1:
        raise ArgumentError(f"max_iterations must be >= 0 and n_init >= 1, got {max_iterations} and {n_init}")
    problem = prepare(clouds, min_std, relative_floor, covariance_floor, tolerance, accelerate)
    if initial is not None:
        start = components_from_mixtures(problem, initial)
        return _result(problem, run_em(problem.workload, start, max_iterations), problem.normalized.status)
    if num_components is None:
        raise ArgumentError("fit_em needs num_components, or initial mixtures to start from")
    held, status = feasible_components(problem, num_components)
    starts = several_starts(problem, held, initializer, seed, n_init)
    workload = problem.workload.take(list(range(len(held))) * n_init)
    states = run_em(workload, starts, max_iterations)
    best = states.take(best_start(-states.objective, n_init))
    return _result(problem, best, status)


def run_em(
    workload: Workload, start: Components, max_iterations: int, clouds: Sequence[int] | None = None
) -> EMState:
    """EM until the gain is at most the tolerance, for all clouds or for these (host-known).

    The tensor operations leave a gain in float32 uncertain by about as much as the tolerance of "mdl", so that a stop
    would be an accident: on a device, the iterations that decide it are made in float64, from where float32 has
    stopped, again at most `max_iterations`.
    """
    if workload.tiles.on_cpu:
        return _run_compiled(workload, start, max_iterations, clouds)
    state = _run(workload, start, max_iterations, clouds)
    if workload.tolerance is None or workload.tiles.dtype == torch.float64:
        return state
    precise = _run(workload.in_double, state.components, max_iterations, clouds)
    return replace(precise, num_iterations=state.num_iterations + precise.num_iterations)


def _run_compiled(
    workload: Workload, start: Components, max_iterations: int, clouds: Sequence[int] | None
) -> EMState:
    """EM by loops that Numba has compiled."""
    from gmmtorch.compiled.em import iterate  # 0.4 s: the import of Numba

    members = _with_points(workload, clouds)
    if not members:
        return EMState.start(start)
    reached = iterate(workload, start, max_iterations, members)
    state = EMState(
        components=reached.mixtures.components(),
        objective=torch.from_numpy(reached.totals[:, 0].copy()),
        log_likelihood=torch.from_numpy(reached.totals[:, 1].copy()),
        gain=torch.from_numpy(reached.gain),
        num_iterations=torch.from_numpy(reached.num_iterations),
        converged=torch.from_numpy(reached.converged),
        step=torch.from_numpy(reached.step),
    )
    return _evaluated(workload, state)


def _with_points(workload: Workload, clouds: Sequence[int] | None) -> list[int]:
    """Those of these clouds, or of all, that have points."""
    counts = workload.tiles.counts
    return [b for b in (range(len(counts)) if clouds is None else clouds) if counts[b] > 0]


def _run(workload: Workload, start: Components, max_iterations: int, clouds: Sequence[int] | None) -> EMState:
    """EM by tensor operations, in the precision of the workload.

    A cloud that has converged is frozen; when the frozen ones make up enough of the work, the others are repacked
    without them. No iteration synchronises the device, except to look at convergence now and then.
    """
    everything = EMState.start(start)
    members = _with_points(workload, clouds)
    if not members:
        return everything
    part, rows = workload.take(members), torch.tensor(members, device=start.weights.device)
    state = everything.take(rows)
    statistics = expectation(part.tiles, state.components, part.floor)
    state = replace(state, objective=statistics.objective, log_likelihood=statistics.log_likelihood)
    for iteration in range(max_iterations):
        state, statistics = _stepper(part, state)(state, statistics)
        if workload.tolerance is None or (iteration + 1) % _LOOK_EVERY:
            continue
        running = [i for i, done in enumerate(state.converged.tolist()) if not done]
        if sum(part.tiles.counts[i] for i in running) > _REPACK_BELOW * sum(part.tiles.counts):
            continue
        everything = everything.put(rows, _evaluated(part, state))
        if not running:
            return everything
        kept = torch.tensor(running, device=rows.device)
        part, rows, state = part.take(running), rows[kept], state.take(kept)
        statistics = statistics.take(kept)
    return everything.put(rows, _evaluated(part, state))


def _stepper(workload: Workload, state: EMState) -> Stepper:
    """What makes the iterations of this workload, for as many slots as the state has."""
    slots = state.components.weights.shape[1]
    if slots not in workload.steppers:
        tiles_and_more = replace(workload)  # without the steppers: no cycle keeps the device's memory
        workload.steppers[slots] = Stepper(
            lambda state, statistics: em_step(tiles_and_more, state, statistics)
        )
    return workload.steppers[slots]


def em_step(workload: Workload, state: EMState, statistics: Statistics) -> tuple[EMState, Statistics]:
    """One M-step and the E-step that values it; clouds that have converged keep what they have.

    Where the workload is over-relaxed, a longer step that lowers the objective is undone and the next one is EM's own;
    only a step of EM's own ends the iterations of a cloud.
    """
    running = ~state.converged
    target = statistics
    if workload.relaxation > 1.0:
        target = extrapolate(statistics, state.components, workload, state.step)
    proposal = maximization(target, state.components, workload)
    components = proposal.where(running, state.components)
    valued = expectation(workload.tiles, components, workload.floor)
    gain = torch.where(running, valued.objective - state.objective, state.gain)
    small = torch.zeros_like(running) if workload.tolerance is None else gain <= workload.tolerance
    plain = state.step <= 1.0
    proposed = EMState(
        components=components,
        objective=valued.objective,
        log_likelihood=valued.log_likelihood,
        gain=gain,
        num_iterations=state.num_iterations + running,
        converged=state.converged | (small & plain),
        step=torch.where(small, 1.0, (state.step * workload.relaxation).clamp_max(LONGEST_STEP)),
    )
    if workload.relaxation <= 1.0:
        return proposed, valued
    kept = plain | (gain >= 0)
    undone = replace(state, num_iterations=proposed.num_iterations, step=torch.ones_like(state.step))
    return proposed.where(kept, undone), valued.where(kept, statistics)


def extrapolate(statistics: Statistics, previous: Components, workload: Workload, step: Tensor) -> Statistics:
    """Statistics beyond those of the E-step, as seen from the mixture that it was made with.

    EM moves the expected statistics from those of the previous mixture to those of the E-step, and where components
    overlap it falls far short each time. A longer step, s + step (s' - s), needs fewer of them
    (Salakhutdinov & Roweis 2003, adaptive overrelaxed EM; there in the parameters, here in the statistics, where the
    constraints are linear). A cloud takes EM's own step where a longer one would leave a component without a positive
    covariance, or with half of what the E-step gives it.

    Args:
        statistics: of the E-step with the previous mixture.
        previous: that mixture.
        workload: the batch.
        step: length of the step (B,), at least 1.
    """
    length = step[:, None]
    identity = torch.eye(previous.means.shape[-1], dtype=step.dtype, device=step.device)
    before = previous.weights * workload.total[:, None]  # (B, K)
    spread = previous.covariances - workload.added[:, None, None, None] * identity
    longer = replace(
        statistics,
        counts=torch.lerp(before, statistics.counts, length),
        first=length[..., None] * statistics.first,  # about the previous means, those of the mixture are 0
        second=torch.lerp(before[..., None, None] * spread, statistics.second, length[..., None, None]),
    )
    covariances = longer.covariances() + workload.added[:, None, None, None] * identity
    possible = (longer.counts > LEAST_SHARE * statistics.counts) & linalg.is_positive(covariances)
    allowed = (step > 1.0) & (possible | (previous.weights == 0)).all(1)
    return longer.where(allowed, statistics)


def maximization(statistics: Statistics, previous: Components, workload: Workload) -> Components:
    """M-step: the mixture that maximises the expected log-likelihood.

    Components that explain nothing any more are dropped. A covariance that round-off left without a Cholesky factor
    keeps its previous value, which can only make the step smaller.
    """
    counts = torch.where(
        (previous.weights > 0) & (statistics.counts > workload.starved[:, None]), statistics.counts, 0.0
    )
    shift = statistics.first / torch.where(counts > 0, counts, 1.0)[..., None]
    covariances = statistics.covariances()
    trace = covariances.diagonal(dim1=-2, dim2=-1).sum(-1)  # (B, K)
    identity = torch.eye(shift.shape[-1], dtype=shift.dtype, device=shift.device)
    covariances = covariances + (workload.added[:, None] + ROUND_OFF * trace)[..., None, None] * identity
    factors, positive = linalg.safe_cholesky(covariances)
    usable = (positive & (counts > 0))[..., None, None]
    total = counts.sum(1, keepdim=True)
    return Components(
        weights=counts / torch.where(total > 0, total, 1.0),
        means=torch.where(usable[..., 0], statistics.reference + shift, statistics.reference),
        covariances=torch.where(usable, covariances, previous.covariances),
        factors=torch.where(usable, factors, previous.factors),
    )


def final_status(problem: Problem, state: EMState, before: Sequence[Status], must_converge: bool) -> Tensor:
    """Status (B,) int64: what stood in the way before EM, then the floor, then missing convergence."""
    precision = state.components.precisions.diagonal(dim1=-2, dim2=-1).sum(-1)  # (B, K)
    from_floor = problem.workload.added[:, None] * precision >= _AT_FLOOR
    at_floor = (from_floor & (state.components.weights > 0)).any(1)
    status = torch.where(at_floor, int(Status.FLOOR_REACHED), int(Status.OK))
    if must_converge:
        status = torch.where(state.converged, status, int(Status.NOT_CONVERGED))
    known = torch.tensor([int(s) for s in before], device=status.device)
    return torch.where(known == int(Status.OK), status, known)


def _evaluated(workload: Workload, state: EMState) -> EMState:
    """The state with its log-likelihood in float64, unless iterations in float64 will follow."""
    will_follow = workload.tolerance is not None and not workload.tiles.on_cpu
    if workload.tiles.dtype == torch.float64 or will_follow:
        return state
    return replace(state, log_likelihood=log_likelihood(workload.tiles, state.components))


def _result(problem: Problem, state: EMState, status: Sequence[Status]) -> EMResult:
    """Bring a state back to the caller's units."""
    volume = problem.workload.volume
    return EMResult(
        mixtures=mixtures_from_components(problem, state.components),
        log_likelihood=state.log_likelihood - volume,
        objective=state.objective - volume,
        num_iterations=state.num_iterations,
        converged=state.converged,
        status=final_status(problem, state, status, problem.workload.tolerance is not None),
    )
