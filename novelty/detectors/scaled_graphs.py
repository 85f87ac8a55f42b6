"""Correspondence graphs without a length to choose: eqs. 9-12 in units of the components themselves.

In metres, one pair of thresholds cannot serve a table top and a corridor. Here the means of two components are
compared in units of their own extent (Mahalanobis distance under the mean of both covariances), and the relative
constraint of eq. 12 is taken relative to the distances it compares, so that far components, whose distances
differ more between two fits of the same surfaces, are not held to a stricter rule than near ones:

    w^2 = |d_Theta^2 - d_Gamma^2| / (1 + (d_Theta^2 + d_Gamma^2) / 2).

The 1 keeps distances that are small in both mixtures from mattering. U_T and U_R become pure numbers. The other reading
of eq. 12, without its squares, has none here either.
"""

from __future__ import annotations

import torch
from torch import Tensor

from gmmtorch.distances import covariance_distance
from novelty.matching import ArcTerms, Components, CorrespondenceGraphs, arc_terms
from novelty.matching.correspondence import between_nodes, list_nodes


def build_scaled_graphs(
    a: Components,
    b: Components,
    node_threshold: float,
    arc_threshold: float,
    terms: ArcTerms = "squared",
) -> CorrespondenceGraphs:
    """Form nodes and arcs of P pairs at once; the largest number of nodes is read once, which synchronises.

    Args:
        a: components of the first mixtures, with K_a of them.
        b: components of the second mixtures, with K_b of them.
        node_threshold: U_T; a node has max(d_mu, d_Sigma) < U_T.
        arc_threshold: U_R; an arc has max(w_mu, w_Sigma) <= U_R.
        terms: Whether eq. 12 subtracts squared distances, as printed, or the distances themselves.

    Returns:
        Graphs whose distances are pure numbers; a component has one partner at most.
    """
    table = scaled_distance(a, b)
    alive = (a.weights > 0)[:, :, None] & (b.weights > 0)[:, None, :]
    nodes_a, nodes_b, distances, num_nodes = list_nodes(table, alive & (table < node_threshold))
    exists = nodes_a >= 0
    apart = (nodes_a[:, :, None] != nodes_a[:, None, :]) & (nodes_b[:, :, None] != nodes_b[:, None, :])
    adjacency = exists[:, :, None] & exists[:, None, :] & apart  # (P, V, V)
    for inner_a, inner_b in zip(_inner_distances(a), _inner_distances(b), strict=True):
        terms_a = between_nodes(arc_terms(inner_a, terms), nodes_a)
        terms_b = between_nodes(arc_terms(inner_b, terms), nodes_b)
        adjacency &= relative_terms(terms_a, terms_b) <= arc_threshold**2  # w^2
    return CorrespondenceGraphs(nodes_a, nodes_b, distances, adjacency, num_nodes, table, node_threshold)


def scaled_distance(a: Components, b: Components) -> Tensor:
    """Eq. 9 in units of the components' own extent (P, K_a, K_b)."""
    return torch.maximum(scaled_mean_distance(a, b), covariance_distance(a.covariances, b.covariances))


def relative_terms(terms_a: Tensor, terms_b: Tensor) -> Tensor:
    """The difference of eq. 12's terms relative to the terms themselves, w^2."""
    return (terms_a - terms_b).abs() / (1 + (terms_a + terms_b) / 2)


def scaled_mean_distance(a: Components, b: Components) -> Tensor:
    """Mahalanobis distance between means under the mean of both covariances (P, K_a, K_b)."""
    covariances = (a.covariances[:, :, None] + b.covariances[:, None, :]) / 2
    difference = (a.means[:, :, None] - b.means[:, None, :])[..., None]
    factor = torch.linalg.cholesky_ex(covariances).L
    return torch.linalg.solve_triangular(factor, difference, upper=False).squeeze(-1).norm(dim=-1)


def _inner_distances(side: Components) -> tuple[Tensor, Tensor]:
    """The two distances between the components of one mixture, each (P, K, K)."""
    return scaled_mean_distance(side, side), covariance_distance(side.covariances, side.covariances)
