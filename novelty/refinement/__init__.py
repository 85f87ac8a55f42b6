"""Labels finer than components."""

from novelty.refinement.refine import OffSurface, Refine, measure_off_surface, refine
from novelty.refinement.surface import own_distances, surface_distances

__all__ = ["OffSurface", "Refine", "measure_off_surface", "own_distances", "refine", "surface_distances"]
