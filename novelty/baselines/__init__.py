"""Baselines: the plain methods that the detectors are measured against. They compare points and fit nothing."""

from novelty.baselines.base import Baseline
from novelty.baselines.m3c2 import M3C2
from novelty.baselines.nearest_neighbour import NearestNeighbour
from novelty.baselines.voxel_difference import VoxelDifference

__all__ = ["M3C2", "Baseline", "NearestNeighbour", "VoxelDifference"]
