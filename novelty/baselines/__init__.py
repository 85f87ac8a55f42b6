"""Baselines: the plain methods that the detectors are measured against.

Three compare points and fit nothing; two put another clustering in the place of the mixtures of section 2.3.
"""

from novelty.baselines.base import Baseline, PointBaseline
from novelty.baselines.fuzzy_clustering import FuzzyPartitions, fit_fuzzy_partitions
from novelty.baselines.fuzzy_partition import FuzzyPartition
from novelty.baselines.kmeans_mixture import KMeansMixture
from novelty.baselines.m3c2 import M3C2
from novelty.baselines.nearest_neighbour import NearestNeighbour
from novelty.baselines.voxel_difference import VoxelDifference

__all__ = [
    "M3C2",
    "Baseline",
    "FuzzyPartition",
    "FuzzyPartitions",
    "KMeansMixture",
    "NearestNeighbour",
    "PointBaseline",
    "VoxelDifference",
    "fit_fuzzy_partitions",
]
