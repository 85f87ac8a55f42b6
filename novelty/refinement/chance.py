"""How large a group of points off the surface is without any change, where rays cannot tell.

Foliage, wires and surfaces sampled thinly leave groups of points off every surface in two scans of one place. A scan
shows by itself how large they get: half of its points are compared with the surfaces of the other half, as those of
another scan would be, and the largest group that results is one of chance. (The largest cluster under the null is what
cluster inference takes its threshold from; Nichols & Holmes 2002.)
"""

from __future__ import annotations

import torch

from novelty.clusters import novel_clusters
from novelty.preprocess import PreparedScans
from novelty.refinement.surface import cells_of_members, drawn, surface_distances

IN_FULL = 2
"""A scan has this many times the points of its half."""


def chance_group_sizes(
    scans: PreparedScans, resolution: torch.Tensor, threshold: torch.Tensor, asked: list[bool]
) -> torch.Tensor:
    """Points of the largest group off the surface that a scan shows against itself, int64 (B,).

    Args:
        scans: B scans.
        resolution: (B,) m, see `surface_distances`.
        threshold: (B,) squared distance above which a point is off the surface.
        asked: For each scan, whether to look; 0 is the answer where not.
    """
    sizes = torch.zeros(len(scans), dtype=torch.long)
    rows = [row for row, wanted in enumerate(asked) if wanted and scans.points.sizes[row]]
    if not rows:
        return sizes
    chosen = scans.select(rows)
    half = drawn(chosen.points, chosen.cell_of_point, one_in=2)
    cells = cells_of_members(chosen.points, chosen.cell_of_point, half)
    distances = surface_distances(chosen.points, cells, resolution[rows])
    off = (distances > threshold[rows][chosen.points.cloud_index]) & ~half
    groups = chosen.points.split(novel_clusters(chosen, off))
    largest = [int(torch.bincount(group[group >= 0], minlength=1).max()) for group in groups]
    sizes[rows] = IN_FULL * torch.tensor(largest)
    return sizes
