"""Labels finer than components."""

from novelty.refinement.refine import OffSurface, Refine, measure_off_surface, refine
from novelty.refinement.surface import own_quantile, surface_distances

__all__ = ["OffSurface", "Refine", "measure_off_surface", "own_quantile", "refine", "surface_distances"]
