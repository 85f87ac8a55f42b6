"""Structural matching: correspondence graphs and their maximum cliques."""

from novelty.matching.clique import Clique, CliqueStatus, maximum_clique
from novelty.matching.correspondence import Components, CorrespondenceGraphs, build_correspondence_graphs
from novelty.matching.structural import StructuralMatches, match_structure

__all__ = [
    "Clique",
    "CliqueStatus",
    "Components",
    "CorrespondenceGraphs",
    "StructuralMatches",
    "build_correspondence_graphs",
    "match_structure",
    "maximum_clique",
]
