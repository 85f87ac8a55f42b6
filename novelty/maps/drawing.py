"""Points in the place of cells: where a comparison asks for the points of a scan, a map draws them."""

from __future__ import annotations

import torch

from gmmtorch import PointClouds

STEPS = (0.7548776662466927, 0.5698402909980532)
"""1 / p and 1 / p^2, p^3 = p + 1: multiples of these, modulo 1, fill a square evenly whatever their number."""


def draw_points(cells: PointClouds) -> tuple[PointClouds, torch.Tensor]:
    """Draw every cell of one cloud by as many points as it stands for; always the same for the same cells.

    Points of a scan fill their patch of surface evenly and scatter about it by noise: they are drawn evenly along the
    two longer axes of the cell and normally along the shortest.

    Returns:
        The points, those of a cell together, and the row of the cell of each, int64 (N,).
    """
    assert cells.spreads is not None
    counts = cells.weights.round().long()
    cell = torch.repeat_interleave(torch.arange(len(counts)), counts)  # (N,)
    place = torch.arange(len(cell)) - (counts.cumsum(0) - counts)[cell]  # within the cell
    square = (0.5 + place[:, None] * torch.tensor(STEPS, dtype=torch.float64)) % 1.0  # (N, 2)
    along = (2 * square - 1) * 3**0.5  # of variance 1
    across = torch.randn(len(cell), 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    values, axes = torch.linalg.eigh(cells.spreads)  # ascending
    offsets = torch.cat([across, along], dim=1) * values.clamp_min(0).sqrt()[cell]
    return PointClouds.from_list([cells.points[cell] + (axes[cell] @ offsets[:, :, None])[:, :, 0]]), cell
