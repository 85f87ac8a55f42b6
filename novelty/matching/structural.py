"""Structural matching of two mixtures: the maximum clique of their correspondence graph (section 2.4.2)."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from novelty.matching.clique import Clique, maximum_clique
from novelty.matching.correspondence import CorrespondenceGraphs


@dataclass(frozen=True)
class StructuralMatches:
    """The mutually consistent matches of P mixture pairs; components without a partner are the novelties.

    Attributes:
        partners_a: component of the second mixture matched to each of the first (P, K_a), int64; -1 is none.
        partners_b: component of the first mixture matched to each of the second (P, K_b), int64; -1 is none.
        num_matches: size of each clique (P,), int64.
        status: a `CliqueStatus` per pair (P,), int8.
    """

    partners_a: Tensor
    partners_b: Tensor
    num_matches: Tensor
    status: Tensor


def match_structure(graphs: CorrespondenceGraphs, node_budget: int = 20_000) -> StructuralMatches:
    """Match the components of every pair by the maximum clique of its graph.

    Of the cliques with most nodes the one with the least sum of distances is taken: each node weighs
    1 - d / (U_T K^2), and since a clique has K nodes at most, all its deductions together stay below 1.

    Args:
        graphs: correspondence graphs of P pairs, on any device; the search runs on the CPU.
        node_budget: nodes of one pair's search tree after which the best clique found is taken, unproven.

    Returns:
        The matches.
    """
    num_pairs, K_a, K_b = graphs.table.shape
    adjacency, distances = graphs.adjacency.cpu().numpy(), graphs.distances.cpu().numpy()
    nodes_a, nodes_b = graphs.nodes_a.cpu().numpy(), graphs.nodes_b.cpu().numpy()
    weights = 1 - distances / (graphs.node_threshold * min(K_a, K_b) ** 2)  # (P, V)
    partners_a, partners_b = np.full((num_pairs, K_a), -1), np.full((num_pairs, K_b), -1)
    cliques: list[Clique] = []
    for p, V in enumerate(graphs.num_nodes.tolist()):
        clique = maximum_clique(adjacency[p, :V, :V], weights[p, :V], node_budget)
        chosen = list(clique.vertices)
        partners_a[p, nodes_a[p, chosen]] = nodes_b[p, chosen]
        partners_b[p, nodes_b[p, chosen]] = nodes_a[p, chosen]
        cliques.append(clique)
    sizes = np.array([len(clique.vertices) for clique in cliques], dtype=np.int64)
    status = np.array([clique.status for clique in cliques], dtype=np.int8)
    fields = (partners_a, partners_b, sizes, status)
    return StructuralMatches(*(torch.from_numpy(x).to(graphs.table.device) for x in fields))
