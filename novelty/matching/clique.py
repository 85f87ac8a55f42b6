"""Exact maximum clique of a weighted graph: bitset branch and bound with a colouring bound.

The method is that of Tomita and Seki (2003) and San Segundo et al. (2011): candidates are coloured greedily so that no
two of a colour are joined; a clique takes one vertex of a colour at most, so the heaviest vertices of the colours
bound the weight that can still be gained. Sets of vertices are Python integers, whose bitwise operations run over
words of the machine. The graph with the largest total weight wins, so with weights of (nearly) 1 it is the clique with
most vertices, and among these the heaviest.
"""

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_FRACTION_BITS = 40  # weights become integers, so that sums are exact and ties do not depend on rounding


class CliqueStatus(enum.IntEnum):
    """Whether the search came to its end; `advice` says what to do about it."""

    advice: str

    def __new__(cls, value: int, advice: str) -> "CliqueStatus":
        """Attach the advice to the integer member."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.advice = advice
        return member

    MAXIMUM = 0, "no clique has more weight"
    NOT_PROVEN_MAXIMAL = (
        1,
        "the node budget ran out; raise it, or tighten the thresholds to thin out the graph",
    )


@dataclass(frozen=True)
class Clique:
    """The heaviest clique found.

    Attributes:
        vertices: its vertices in ascending order.
        num_searched: nodes of the search tree that were visited.
        status: whether it is proven to be the heaviest.
    """

    vertices: tuple[int, ...]
    num_searched: int
    status: CliqueStatus


def maximum_clique(
    adjacency: NDArray[np.bool_], weights: NDArray[np.float64], node_budget: int = 20_000
) -> Clique:
    """The clique of largest total weight.

    Equals `networkx.max_weight_clique`. Deterministic: of cliques of the same weight the one met first is kept.

    Args:
        adjacency: True where two vertices are joined (V, V): symmetric, the diagonal False.
        weights: positive weight of each vertex (V,), at most about 1; differences below 1e-12 are not seen.
        node_budget: nodes of the search tree after which the best clique found so far is returned.

    Returns:
        The clique, and whether it is proven.
    """
    order = _degeneracy_order(adjacency)
    integers = np.rint(weights[order] * 2.0**_FRACTION_BITS).astype(np.int64)
    search = _Search(_bitsets(adjacency[np.ix_(order, order)]), integers.tolist(), node_budget)
    search.expand((1 << len(order)) - 1, [], 0)
    status = CliqueStatus.NOT_PROVEN_MAXIMAL if search.exhausted else CliqueStatus.MAXIMUM
    return Clique(tuple(sorted(order[search.best].tolist())), search.num_searched, status)


class _Search:
    """State of one branch and bound."""

    def __init__(self, neighbours: list[int], weights: list[int], node_budget: int) -> None:
        self.neighbours = neighbours
        self.strangers = [~bits for bits in neighbours]
        self.weights = weights
        self.node_budget = node_budget
        self.best: list[int] = []
        self.best_weight = 0
        self.num_searched = 0

    @property
    def exhausted(self) -> bool:
        """Whether the budget ran out before the search came to its end."""
        return self.num_searched > self.node_budget

    def expand(self, candidates: int, clique: list[int], weight: int) -> None:
        """Search the cliques that extend `clique` by `candidates`, all of them joined to all of it."""
        self.num_searched += 1
        if weight > self.best_weight:
            self.best, self.best_weight = clique, weight
        vertices, bounds = self._colour(candidates, self.best_weight - weight)
        for vertex, bound in zip(reversed(vertices), reversed(bounds), strict=True):
            if weight + bound <= self.best_weight or self.exhausted:
                return
            gained = weight + self.weights[vertex]
            self.expand(candidates & self.neighbours[vertex], [*clique, vertex], gained)
            candidates &= ~(1 << vertex)

    def _colour(self, candidates: int, needed: int) -> tuple[list[int], list[int]]:
        """Vertices to branch on, and for each the most that it and those before it can gain.

        Vertices whose bound does not exceed `needed` are coloured but not listed: no branch can start from them.
        """
        weights, strangers = self.weights, self.strangers
        vertices: list[int] = []
        bounds: list[int] = []
        bound = 0
        while candidates:
            free = candidates
            heaviest = 0
            while free:
                lowest = free & -free
                vertex = lowest.bit_length() - 1
                candidates ^= lowest
                free = (free ^ lowest) & strangers[vertex]
                heaviest = max(heaviest, weights[vertex])
                if bound + heaviest > needed:
                    vertices.append(vertex)
                    bounds.append(bound + heaviest)
            bound += heaviest
        return vertices, bounds


def _degeneracy_order(adjacency: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Vertices, those in the densest part first: the one of least remaining degree is put last, and so on."""
    num_vertices = len(adjacency)
    rows = adjacency.astype(np.int64)
    degrees = rows.sum(axis=1)
    order = np.empty(num_vertices, dtype=np.int64)
    for place in reversed(range(num_vertices)):
        vertex = degrees.argmin()
        order[place] = vertex
        degrees -= rows[vertex]
        degrees[vertex] = 2 * num_vertices  # out: stays above every degree that is left
    return order


def _bitsets(adjacency: NDArray[np.bool_]) -> list[int]:
    """Each row as an integer whose bit v is adjacency[row, v]."""
    packed = np.packbits(adjacency, axis=1, bitorder="little")
    return [int.from_bytes(row.tobytes(), "little") for row in packed]
