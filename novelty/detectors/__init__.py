"""Detectors: what of one scan has no counterpart in the other."""

from novelty.detectors.base import Comparison, ComponentNovelty, Detector, PointNovelty
from novelty.detectors.greedy_emd import GreedyEmd
from novelty.detectors.joint_mixture import JointMixture
from novelty.detectors.likelihood import Likelihood
from novelty.detectors.structural_matching import StructuralMatching
from novelty.detectors.unbalanced_emd import UnbalancedEmd

__all__ = [
    "Comparison",
    "ComponentNovelty",
    "Detector",
    "GreedyEmd",
    "JointMixture",
    "Likelihood",
    "PointNovelty",
    "StructuralMatching",
    "UnbalancedEmd",
]
