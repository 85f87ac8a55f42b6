"""Labels finer than components."""

from novelty.refinement.refine import Refine, refine
from novelty.refinement.surface import own_quantile, surface_distances

__all__ = ["Refine", "own_quantile", "refine", "surface_distances"]
