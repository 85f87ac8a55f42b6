"""Correspondence graphs by four nested loops and their maximum cliques by networkx."""

import itertools

import networkx as nx
import numpy as np

from tests.reference import distances

WEIGHT_UNITS = 10**12  # networkx wants integers


def maximum_clique(adjacency: np.ndarray, weights: np.ndarray) -> tuple[list[int], int]:
    """The clique of largest total weight and that weight, in units of 1e-12."""
    graph = nx.from_numpy_array(adjacency)
    for vertex, weight in enumerate(weights):
        graph.nodes[vertex]["weight"] = round(weight * WEIGHT_UNITS)
    return nx.max_weight_clique(graph, weight="weight")


def correspondence_graph(
    a: tuple[np.ndarray, np.ndarray],
    b: tuple[np.ndarray, np.ndarray],
    node_threshold: float,
    arc_threshold: float,
    length_scale: float,
    power: int = 2,
) -> tuple[list[tuple[int, int]], set[frozenset[tuple[int, int]]]]:
    """Nodes (i, j) and arcs of one pair from (means, covariances) of either mixture, eqs. 9-12; 2 is eq. 12's power."""

    def d_mean(x, i, y, j):
        return np.linalg.norm(x[0][i] - y[0][j]) / length_scale

    def d_covariance(x, y):
        return [[distances.covariance_distance(first, second) for second in y[1]] for first in x[1]]

    across, within_a, within_b = d_covariance(a, b), d_covariance(a, a), d_covariance(b, b)
    pairs = itertools.product(range(len(a[0])), range(len(b[0])))
    nodes = [(i, j) for i, j in pairs if max(d_mean(a, i, b, j), across[i][j]) < node_threshold]
    arcs = set()
    for (i, j), (k, m) in itertools.combinations(nodes, 2):
        w_mean = np.sqrt(abs(d_mean(a, i, a, k) ** power - d_mean(b, j, b, m) ** power))
        w_covariance = np.sqrt(abs(within_a[i][k] ** power - within_b[j][m] ** power))
        if i != k and j != m and max(w_mean, w_covariance) <= arc_threshold:
            arcs.add(frozenset([(i, j), (k, m)]))
    return nodes, arcs
