"""Exact optimal transport between mixtures: the earth mover's distance (eq. 8) and its unbalanced form.

The linear programs are small (K_a x K_b) and are solved one after the other by the network simplex of POT,
on the CPU and in float64. It holds Python's global lock, so threads do not pay (measured at K = 16, 30 and
200). Masses and costs are scaled to 1 before they reach it, so a scene in millimetres is solved like one in
metres.

Every answer carries its own proof: the potentials are made feasible, so `gap` (primal minus dual objective)
bounds how far from the optimum the plan can be.
"""

import enum
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gmmtorch.errors import ArgumentError, ShapeError

Array = NDArray[np.float64]

_POT_OPTIMAL = 1
_POT_ITERATIONS = 1_000_000  # pivots; K = 30 needs a few hundred


class TransportStatus(enum.IntEnum):
    """What became of one pair of mixtures; `advice` says what to do about it."""

    advice: str

    def __new__(cls, value: int, advice: str) -> "TransportStatus":
        """Attach the advice to the integer member."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.advice = advice
        return member

    OPTIMAL = 0, "the plan is optimal; `gap` certifies it"
    NO_MASS = 1, "a mixture has no weight at all; fit it again, or leave the pair out"
    INVALID = (
        2,
        "a weight is negative or not finite, or a cost between components with weight is not finite; "
        "look for covariances that are not positive definite",
    )
    NOT_CONVERGED = 3, "the network simplex stopped at its limit of pivots; check the range of the costs"


@dataclass(frozen=True)
class Transport:
    """Optimal transport between the mixtures of B pairs, each mixture's weights brought to a total of 1.

    Attributes:
        distance: the earth mover's distance (B,), in the unit of the cost; NaN unless the status is OPTIMAL.
        plan: weight carried from each component of a to each of b (B, K_a, K_b).
        potentials_a: dual potentials u (B, K_a), in the unit of the cost; 0 where the weight is 0.
        potentials_b: dual potentials v (B, K_b), u_i + v_j <= cost_ij between components with weight.
        gap: primal minus dual objective (B,): the distance exceeds the optimum by at most this much.
        status: a `TransportStatus` per pair (B,), int8.
    """

    distance: Tensor
    plan: Tensor
    potentials_a: Tensor
    potentials_b: Tensor
    gap: Tensor
    status: Tensor


@dataclass(frozen=True)
class UnbalancedTransport:
    """Optimal transport that may leave mass of either mixture unmatched, for B pairs.

    Attributes:
        total_cost: transport plus tau times all unmatched mass (B,), cost x mass; NaN unless OPTIMAL.
        plan: mass carried from each component of a to each of b (B, K_a, K_b).
        unmatched_a: mass of each component of a with no partner in b (B, K_a): what was added, if a is current.
        unmatched_b: mass of each component of b with no partner in a (B, K_b): what was removed.
        gap: primal minus dual objective (B,), cost x mass.
        status: a `TransportStatus` per pair (B,) int8.
    """

    total_cost: Tensor
    plan: Tensor
    unmatched_a: Tensor
    unmatched_b: Tensor
    gap: Tensor
    status: Tensor


class PairSolution(NamedTuple):
    """One transport problem solved: plan (m, n), potentials (m,) and (n,), total cost."""

    plan: Array
    potentials_a: Array
    potentials_b: Array
    cost: float
    optimal: bool


def emd(weights_a: Tensor, weights_b: Tensor, cost: Tensor) -> Transport:
    """Earth mover's distance d_GMM between the mixtures of every pair (eq. 8), exact.

    Equals `ot.emd2(a / a.sum(), b / b.sum(), cost)` pair by pair. The tensors may lie on any device; the
    solver runs on the CPU, which synchronises once.

    Args:
        weights_a: weights of the first mixtures (B, K_a); 0 marks padding. Each row is brought to total 1.
        weights_b: weights of the second mixtures (B, K_b).
        cost: ground distances (B, K_a, K_b), for instance from `gmmtorch.distances`.

    Returns:
        The distances with their plans and certificates.

    Raises:
        ShapeError: the shapes do not fit together.
    """
    check_shapes(weights_a, weights_b, cost)
    masses_a, masses_b = to_array(weights_a), to_array(weights_b)
    solved = _solve_batch(_normalised(masses_a), _normalised(masses_b), to_array(cost))
    return Transport(*(torch.from_numpy(field).to(cost.device) for field in solved))


def unbalanced_emd(
    masses_a: Tensor, masses_b: Tensor, cost: Tensor, tau: float | Tensor
) -> UnbalancedTransport:
    """Optimal transport in which unmatched mass costs tau on either side, exact.

    A dummy source of mass sum(b) and a dummy sink of mass sum(a) at cost tau from everything, and at cost 0
    from each other, make the problem balanced. Two components are matched only while their distance is at
    most 2 tau.

    Args:
        masses_a: masses of the first mixtures (B, K_a), for instance expected counts of points; 0
            marks padding. They are taken as they are: bring both sides to one scale first.
        masses_b: masses of the second mixtures (B, K_b).
        cost: ground distances (B, K_a, K_b).
        tau: cost of leaving a unit of mass unmatched, in the unit of `cost`: one number or one per pair (B,).

    Returns:
        Plans, unmatched masses of both sides and certificates.

    Raises:
        ShapeError: the shapes do not fit together.
        ArgumentError: tau is not positive.
    """
    check_shapes(masses_a, masses_b, cost)
    a, b = to_array(masses_a), to_array(masses_b)
    taus = np.broadcast_to(to_array(torch.as_tensor(tau, dtype=torch.float64)), a.shape[:1])
    if not (taus > 0).all():
        raise ArgumentError(
            f"tau must be positive, in the unit of the cost, but its least value is {taus.min()}"
        )
    with_dummies = _add_dummies(to_array(cost), taus)
    sources = np.concatenate([a, b.sum(axis=1, keepdims=True)], axis=1)
    sinks = np.concatenate([b, a.sum(axis=1, keepdims=True)], axis=1)
    total_cost, plan, _, _, gap, status = _solve_batch(sources, sinks, with_dummies)
    fields = (total_cost, plan[:, :-1, :-1], plan[:, :-1, -1], plan[:, -1, :-1], gap, status)
    return UnbalancedTransport(*(torch.from_numpy(np.ascontiguousarray(x)).to(cost.device) for x in fields))


def solve_pair(masses_a: Array, masses_b: Array, cost: Array) -> PairSolution:
    """Solve one transport problem with POT.

    Args:
        masses_a: positive masses (m,), of total 1.
        masses_b: positive masses (n,), of total 1.
        cost: costs (m, n) of magnitude about 1.

    Returns:
        The optimal plan and potentials, feasible up to rounding.
    """
    from ot import emd as network_simplex  # 2 s: POT imports all of itself, whichever module is asked for

    plan, log = network_simplex(
        masses_a,
        masses_b,
        cost,
        numItermax=_POT_ITERATIONS,
        log=True,
        center_dual=False,
        check_marginals=False,
    )
    return PairSolution(plan, log["u"], log["v"], log["cost"], log["result_code"] == _POT_OPTIMAL)


def check_shapes(masses_a: Tensor, masses_b: Tensor, cost: Tensor) -> None:
    """Raise ShapeError unless the shapes are (B, K_a), (B, K_b) and (B, K_a, K_b)."""
    expected = (*masses_a.shape, *masses_b.shape[1:])
    if masses_a.ndim != 2 or masses_b.ndim != 2 or tuple(cost.shape) != expected:
        raise ShapeError(
            "expected weights (B, K_a) and (B, K_b) with a cost (B, K_a, K_b), but got"
            f" {tuple(masses_a.shape)}, {tuple(masses_b.shape)} and {tuple(cost.shape)}"
        )


def pair_status(masses_a: Array, masses_b: Array, cost: Array) -> TransportStatus:
    """Whether a pair can be solved: masses (m,) and (n,), and the costs (m, n) of those with mass."""
    masses = np.concatenate([masses_a, masses_b])
    if not (np.isfinite(masses).all() and (masses >= 0).all() and np.isfinite(cost).all()):
        return TransportStatus.INVALID
    if not (masses_a.any() and masses_b.any()):
        return TransportStatus.NO_MASS
    return TransportStatus.OPTIMAL


def to_array(values: Tensor) -> Array:
    """A float64 array on the host."""
    return values.detach().to("cpu", torch.float64).numpy()


def _normalised(masses: Array) -> Array:
    """Every row divided by its total; rows without mass stay 0."""
    totals = masses.sum(axis=1, keepdims=True)
    return masses / np.where(totals == 0, 1, totals)


def _add_dummies(cost: Array, taus: Array) -> Array:
    """Costs (B, K_a + 1, K_b + 1): tau to and from the dummies, 0 between them."""
    extended = np.empty((cost.shape[0], cost.shape[1] + 1, cost.shape[2] + 1))
    extended[:] = taus[:, None, None]
    extended[:, :-1, :-1] = cost
    extended[:, -1, -1] = 0
    return extended


def _solve_batch(
    masses_a: Array, masses_b: Array, cost: Array
) -> tuple[Array, Array, Array, Array, Array, NDArray[np.int8]]:
    """The fields of `Transport` for balanced masses (B, m) and (B, n), whose distance is a total cost."""
    num_pairs, m, n = cost.shape
    distance, gap = np.full(num_pairs, np.nan), np.full(num_pairs, np.nan)
    plan, u, v = np.zeros((num_pairs, m, n)), np.zeros((num_pairs, m)), np.zeros((num_pairs, n))
    status = np.zeros(num_pairs, dtype=np.int8)
    for p in range(num_pairs):
        rows, columns = np.flatnonzero(masses_a[p]), np.flatnonzero(masses_b[p])
        block = np.ix_(rows, columns)
        a, b, c = masses_a[p, rows], masses_b[p, columns], cost[p][block]
        status[p] = pair_status(a, b, c)
        if status[p] != TransportStatus.OPTIMAL:
            continue
        solution = _solve_scaled(a, b, c)
        if not solution.optimal:
            status[p] = TransportStatus.NOT_CONVERGED
            continue
        plan[p][block], u[p, rows], v[p, columns] = solution[:3]
        distance[p] = solution.cost
        gap[p] = distance[p] - a @ solution.potentials_a - b @ solution.potentials_b
    return distance, plan, u, v, gap, status


def _solve_scaled(masses_a: Array, masses_b: Array, cost: Array) -> PairSolution:
    """Solve at unit mass and cost, scale back, and make the potentials feasible for the costs as given."""
    mass, largest = masses_a.sum(), np.abs(cost).max() or 1.0
    solution = solve_pair(masses_a / mass, masses_b / masses_b.sum(), cost / largest)
    plan, potentials_a = solution.plan * mass, solution.potentials_a * largest
    potentials_b = (cost - potentials_a[:, None]).min(axis=0)
    return PairSolution(plan, potentials_a, potentials_b, (plan * cost).sum(), solution.optimal)
