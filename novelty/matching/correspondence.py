"""Correspondence graphs (section 2.4.2): which components may match, and which matches may hold together.

A node is a pair of components, one of either mixture, that are alike in place and shape (eq. 9). An arc joins two
nodes whose relative distances agree in the two mixtures (eqs. 11-12). A component has one partner at most: two nodes
that share a component are never joined.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from gmmtorch.distances import combined_distance, covariance_distance, mean_distance
from novelty.errors import ConfigError
from novelty.matching.terms import ArcTerms, arc_terms

_CHUNK_ARCS = 200_000  # arcs formed at once: intermediates of 1.6 MB stay in the cache


@dataclass(frozen=True)
class CorrespondenceGraphs:
    """The correspondence graphs of P mixture pairs, padded to the largest number of nodes V.

    Attributes:
        nodes_a: component of the first mixture in each node (P, V), int64; -1 is padding.
        nodes_b: component of the second mixture in each node (P, V), int64; -1 is padding.
        distances: d of each node (P, V), eq. 9; infinite for padding.
        adjacency: True where two nodes are joined (P, V, V): symmetric, False for padding and on the diagonal.
        num_nodes: (P,), int64.
        table: the distances T_t between all components (P, K_a, K_b).
        node_threshold: U_T, which every node's distance is below.
    """

    nodes_a: Tensor
    nodes_b: Tensor
    distances: Tensor
    adjacency: Tensor
    num_nodes: Tensor
    table: Tensor
    node_threshold: float


@dataclass(frozen=True)
class Components:
    """The components of one side of P mixture pairs.

    Attributes:
        weights: (P, K); 0 marks padding, which takes part in no node.
        means: (P, K, D), m.
        covariances: (P, K, D, D), m^2.
    """

    weights: Tensor
    means: Tensor
    covariances: Tensor


def build_correspondence_graphs(
    a: Components,
    b: Components,
    *,
    node_threshold: float = 3.5,
    arc_threshold: float = 1.0,
    length_scale: float = 1.0,
    terms: ArcTerms = "squared",
) -> CorrespondenceGraphs:
    """Form nodes and arcs of all pairs at once.

    The largest number of nodes is read once, which synchronises; the arcs take P V^2 bytes.

    Args:
        a: components of the first mixtures, with K_a of them.
        b: components of the second mixtures, with K_b of them.
        node_threshold: U_T; a node has d < U_T (eq. 9).
        arc_threshold: U_R; an arc has max(w_mu, w_Sigma) <= U_R (eq. 11).
        length_scale: metres that weigh as much as one unit of the covariance distance, in eqs. 9 and 12.
        terms: whether eq. 12 subtracts squared distances, as printed, or the distances themselves.

    Returns:
        The graphs.

    Raises:
        ConfigError: a threshold is not a positive number.
    """
    for name, value in (("node_threshold", node_threshold), ("arc_threshold", arc_threshold)):
        if not 0 < value < math.inf:
            raise ConfigError(f"{name} must be a positive number, but it is {value}")
    table = combined_distance(a.means, a.covariances, b.means, b.covariances, length_scale)  # T_t
    alive = (a.weights > 0)[:, :, None] & (b.weights > 0)[:, None, :]
    nodes_a, nodes_b, distances, num_nodes = list_nodes(table, alive & (table < node_threshold))
    inner_a, inner_b = _inner_terms(a, length_scale, terms), _inner_terms(b, length_scale, terms)
    adjacency = _join_nodes(inner_a, inner_b, nodes_a, nodes_b, arc_threshold)
    return CorrespondenceGraphs(nodes_a, nodes_b, distances, adjacency, num_nodes, table, node_threshold)


def list_nodes(table: Tensor, is_node: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Number the nodes of each pair in the order of their components; pad with -1 and an infinite distance."""
    num_pairs, _, K_b = table.shape
    flags = is_node.reshape(num_pairs, -1)  # (P, K_a K_b)
    num_nodes = flags.sum(dim=1)
    largest = int(num_nodes.max()) if num_pairs else 0
    # A stable sort brings the flagged pairs to the front and keeps their order.
    places = flags.logical_not().to(torch.uint8).sort(dim=1, stable=True).indices[:, :largest]  # (P, V)
    exists = torch.arange(largest, device=table.device) < num_nodes[:, None]
    distances = table.reshape(num_pairs, -1).gather(1, places).masked_fill(~exists, torch.inf)
    nodes_a = places.div(K_b, rounding_mode="floor").masked_fill(~exists, -1)
    nodes_b = places.remainder(K_b).masked_fill(~exists, -1)
    return nodes_a, nodes_b, distances, num_nodes


def _join_nodes(
    tables_a: tuple[Tensor, ...],
    tables_b: tuple[Tensor, ...],
    nodes_a: Tensor,
    nodes_b: Tensor,
    arc_threshold: float,
) -> Tensor:
    """The relative constraint R_t among existing nodes (P, V, V), from the terms of eq. 12, which are overwritten."""
    num_pairs, V = nodes_a.shape
    adjacency = torch.empty(num_pairs, V, V, dtype=torch.bool, device=nodes_a.device)
    for table in tables_a:
        table.diagonal(dim1=1, dim2=2).fill_(torch.inf)  # the same component twice: never joined
    for table in tables_b:
        table.diagonal(dim1=1, dim2=2).fill_(-torch.inf)
    for chunk in _chunks(num_pairs, V):
        exists = nodes_a[chunk] >= 0
        joined = torch.logical_and(exists[:, :, None], exists[:, None, :], out=adjacency[chunk])
        for table_a, table_b in zip(tables_a, tables_b, strict=True):
            # Eq. 12 squared: w^2 = |d_Theta^2 - d_Gamma^2| (or its other reading), which saves the root.
            difference = between_nodes(table_a[chunk], nodes_a[chunk])
            difference.sub_(between_nodes(table_b[chunk], nodes_b[chunk])).abs_()
            joined.logical_and_(difference <= arc_threshold**2)
    return adjacency


def _inner_terms(side: Components, length_scale: float, terms: ArcTerms) -> tuple[Tensor, Tensor]:
    """Eq. 12's terms of d_mu / length_scale and of d_Sigma between the components of one mixture, each (P, K, K)."""
    means = mean_distance(side.means, side.means) / length_scale
    return arc_terms(means, terms), arc_terms(covariance_distance(side.covariances, side.covariances), terms)


def between_nodes(table: Tensor, nodes: Tensor) -> Tensor:
    """table[p, nodes[p, x], nodes[p, y]] (P, V, V) of tables (P, K, K); padding reads component 0."""
    index = nodes.clamp_min(0)
    K, V = table.shape[-1], nodes.shape[1]
    rows = table.gather(1, index[:, :, None].expand(-1, -1, K))  # (P, V, K)
    return rows.gather(2, index[:, None, :].expand(-1, V, -1))


def _chunks(num_pairs: int, V: int) -> Iterator[slice]:
    """Slices of pairs whose arcs fit into the chunk size; one pair at least."""
    step = max(1, _CHUNK_ARCS // max(1, V * V))
    for start in range(0, num_pairs, step):
        yield slice(start, start + step)
