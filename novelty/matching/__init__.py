"""Structural matching: correspondence graphs and their maximum cliques."""

from novelty.matching.clique import Clique, CliqueStatus, maximum_clique
from novelty.matching.correspondence import Components, CorrespondenceGraphs, build_correspondence_graphs
from novelty.matching.merging import Merged, merge_cut_components, unmerged
from novelty.matching.structural import StructuralMatches, match_structure
from novelty.matching.terms import ArcTerms, arc_terms

__all__ = [
    "ArcTerms",
    "Clique",
    "CliqueStatus",
    "Components",
    "CorrespondenceGraphs",
    "Merged",
    "StructuralMatches",
    "arc_terms",
    "build_correspondence_graphs",
    "match_structure",
    "maximum_clique",
    "merge_cut_components",
    "unmerged",
]
