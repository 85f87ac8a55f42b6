"""Greedy removals of Algorithm 2: which components of one mixture keep it away from another.

Each round removes the component whose removal leaves the least earth mover's distance to the other mixture.
The plain loop solves one transport problem per remaining component and round. Here most of them are ruled
out by weak duality: with any potentials u, the best v that keeps u_i + v_j <= C_ij for the rows that remain
is

    v_j = min over i != s of (C_ij - u_i),    LB_s = sum over i != s of a_i u_i / (1 - a_s) + sum_j b_j v_j,

which bounds the distance without s from below. Potentials of every problem solved so far are kept,
completed for the rows they had left out, and the best bound of them all is used. Candidates are solved in
order of their bounds until the bound exceeds the best distance found: the answer is that of the plain loop.

Weights that total 1 hide changes from one another. What was added (A) and what is gone (R) lie far from everything, so
each serves the other at a cost of about 1, the distance is about max(A, R), and no removal of the lesser one lowers it.
It rises, a little, only because what remains is scaled to 1. The work of carrying what remains at its own weights,

    work = distance x remaining weight,

falls all the same, since what is gone need no longer be carried; a component with a counterpart, whose removal makes
its neighbours travel, raises both. `until="work"` stops there.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gmmtorch.errors import ArgumentError
from gmmtorch.transport import Array, TransportStatus, check_shapes, pair_status, solve_pair, to_array

TIE = 1e-12
"""Distances closer than this, relative to the largest cost, are equal; the smaller index is removed first."""


@dataclass(frozen=True)
class Removals:
    """What was removed from the first mixture of each of B pairs, and the whole course of it.

    Attributes:
        removed: True for the components removed for good (B, K_a).
        order: component whose removal led to `distances[b, r]` (B, K_a) int64; -1 for r = 0 and beyond the last round.
            The removal that was put back is the last one listed.
        distances: earth mover's distance after r removals (B, K_a), in the unit of the cost; NaN beyond the last.
        num_removed: number of components removed for good (B,) int64.
        num_solves: transport problems solved (B,) int64.
        status: a `TransportStatus` per pair (B,) int8; where it is not OPTIMAL the removals made until then are kept.
    """

    removed: Tensor
    order: Tensor
    distances: Tensor
    num_removed: Tensor
    num_solves: Tensor
    status: Tensor


def greedy_removals(
    weights_a: Tensor,
    weights_b: Tensor,
    cost: Tensor,
    *,
    tolerance: float = 1e-9,
    renormalise: bool = True,
    until: Literal["distance", "work"] = "distance",
    full_order: bool = False,
) -> Removals:
    """Remove components of the first mixtures while the distance to the second does not rise (Algorithm 2).

    The removal that raised it is put back (line 7). The last component is never removed.

    Args:
        weights_a: weights of the mixtures that lose components (B, K_a); 0 marks padding, never removed.
        weights_b: weights of the mixtures compared with (B, K_b).
        cost: ground distances (B, K_a, K_b).
        tolerance: a rise up to this share of the pair's largest cost is not a rise.
        renormalise: bring the weights of a back to a total of 1 after each removal. False leaves them as they
            are and takes the partial distance of Rubner et al. (1998): all of a is carried, the rest of b
            stays unserved, and the cost is divided by the weight carried. It tends to remove every component.
        until: what ends the removals by rising: the distance, or the work, which is the distance times the weight that
            remains of a. Either way the component whose removal leaves the least distance goes first.
        full_order: go on to the last component after it has risen, for the sake of `order` and
            `distances`; `removed` is the same.

    Returns:
        The removals and their course.

    Raises:
        ShapeError: the shapes do not fit together.
        ArgumentError: `until` is neither "distance" nor "work".
    """
    if until not in ("distance", "work"):
        raise ArgumentError(f"until must be 'distance' or 'work', got {until!r}")
    check_shapes(weights_a, weights_b, cost)
    a, b, costs = to_array(weights_a), to_array(weights_b), to_array(cost)
    num_pairs, K = a.shape
    removed, order = np.zeros((num_pairs, K), dtype=bool), np.full((num_pairs, K), -1)
    distances = np.full((num_pairs, K), np.nan)
    counts = np.zeros((2, num_pairs), dtype=np.int64)
    status = np.zeros(num_pairs, dtype=np.int8)
    for p in range(num_pairs):
        rows, columns = np.flatnonzero(a[p]), np.flatnonzero(b[p])
        active = costs[p][np.ix_(rows, columns)]
        status[p] = pair_status(a[p, rows], b[p, columns], active)
        if status[p] != TransportStatus.OPTIMAL:
            continue
        search = _Search.of(a[p, rows], b[p, columns], active, renormalise)
        status[p] = search.run(tolerance, until == "work", full_order)
        length = len(search.distances)
        order[p, 1:length] = rows[search.order]
        distances[p, :length] = search.distances
        removed[p, order[p, 1 : 1 + search.num_removed]] = True
        counts[:, p] = search.num_removed, search.num_solves
    fields = (removed, order, distances, *counts, status)
    return Removals(*(torch.from_numpy(values).to(cost.device) for values in fields))


@dataclass
class _Search:
    """The removals of one pair. All rows and columns have mass; costs are divided by the largest.

    With partial distances the rows have one more, at cost 0, that serves the part of b which a cannot.
    """

    a: Array  # (m,), total 1
    b: Array  # (n,), total 1
    cost: Array  # (m, n) or, partial, (m + 1, n)
    scale: float
    partial: bool
    order: list[int] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)
    num_removed: int = 0
    num_solves: int = 0
    potentials: dict[int, Array] = field(default_factory=dict)  # u of the last problem without row s, by s

    @classmethod
    def of(cls, a: Array, b: Array, cost: Array, renormalise: bool) -> "_Search":
        """The search for positive weights (m,) and (n,) and their costs (m, n)."""
        scale = np.abs(cost).max() or 1.0
        rows = cost / scale if renormalise else np.vstack([cost / scale, np.zeros_like(b)])
        return cls(a / a.sum(), b / b.sum(), rows, scale, not renormalise)

    def run(self, tolerance: float, by_work: bool, full_order: bool) -> TransportStatus:
        """Algorithm 2, lines 1-7."""
        remaining = np.arange(len(self.a))
        distance, current = self._solve(remaining)
        self.distances.append(distance * self.scale)
        risen = False
        while len(remaining) > 1 and (full_order or not risen) and not np.isnan(distance):
            previous, carried = distance, self.a[remaining].sum()
            s, distance, current = self._select(remaining, current)
            remaining = remaining[remaining != s]
            self.order.append(int(s))
            self.distances.append(distance * self.scale)
            share = self.a[remaining].sum() / carried if by_work else 1.0
            risen = risen or not distance * share <= previous + tolerance
            self.num_removed += not risen
        return TransportStatus.NOT_CONVERGED if np.isnan(distance) else TransportStatus.OPTIMAL

    def _select(self, remaining: NDArray[np.int64], current: Array) -> tuple[int, float, Array]:
        """GreedySelectGMM: the row whose removal leaves the least distance, that distance, its potentials."""
        bounds = self._lower_bounds(remaining, current)
        found: dict[int, float] = {}
        least = np.inf
        for place in np.argsort(bounds, kind="stable"):
            if bounds[place] > least + 2 * TIE:  # one for the tie, one for the rounding of the bound
                break
            s = int(remaining[place])
            found[s], self.potentials[s] = self._solve(remaining[remaining != s])
            if np.isnan(found[s]):
                return s, np.nan, self.potentials[s]
            least = min(least, found[s])
        best = min(s for s, distance in found.items() if distance <= least + TIE)
        return best, found[best], self.potentials.pop(best)

    def _solve(self, rows: NDArray[np.int64]) -> tuple[float, Array]:
        """Distance of the mixture reduced to `rows`, NaN if not solved, and potentials u of all rows."""
        self.num_solves += 1
        carried = self.a[rows].sum()
        masses = self.a[rows] / carried
        if self.partial and len(rows) < len(self.a):
            rows, masses = np.append(rows, len(self.a)), np.append(self.a[rows], 1 - carried)
        solution = solve_pair(masses, self.b, self.cost[rows])
        if not solution.optimal:
            return np.nan, np.zeros(len(self.cost))
        # Rows left out of the problem get the largest potential that is feasible; the others keep theirs.
        potentials = (self.cost - solution.potentials_b).min(axis=1)
        return (solution.cost / carried if self.partial else solution.cost), potentials

    def _lower_bounds(self, remaining: NDArray[np.int64], current: Array) -> Array:
        """For each remaining row s, the best LB_s over all potentials at hand (r,)."""
        rows = np.append(remaining, len(self.a)) if self.partial else remaining
        u = np.stack([current, *self.potentials.values()])[:, rows]  # (q, R)
        slack = self.cost[rows] - u[:, :, None]  # (q, R, n): what v_j may be as far as row i is concerned
        least, second = np.moveaxis(np.partition(slack, 1, axis=1)[:, :2], 1, 0)
        # Without row s, v_j rises from the least to the second least where row s was the least.
        winners = slack.argmin(axis=1) + np.arange(0, u.size, len(rows))[:, None]  # (q, n), into (q * R)
        rises = np.bincount(winners.ravel(), ((second - least) * self.b).ravel(), u.size).reshape(u.shape)
        columns = (least @ self.b)[:, None] + rises[:, : len(remaining)]
        return self._row_terms(u, remaining, columns).max(axis=0)

    def _row_terms(self, u: Array, remaining: NDArray[np.int64], columns: Array) -> Array:
        """LB_s (q, r) from the terms of the columns (q, r) and the potentials of the rows (q, R)."""
        a = self.a[remaining]
        carried = a.sum() - a
        rows = (u[:, : len(a)] @ a)[:, None] - a * u[:, : len(a)]
        if self.partial:
            return (rows + (1 - carried) * u[:, -1:] + columns) / carried
        return rows / carried + columns
