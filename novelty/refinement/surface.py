"""How far points lie from the surface that another scan measured, in units of that surface's own uncertainty.

The cells of simplification are a mixture of thousands of small Gaussians that follows every surface of a scan at the
resolution of its sampling. A point on such a surface is within a few standard deviations of a nearby cell, whatever
the range, the density or the unit; a point off it is not. The squared Mahalanobis distance to the nearest cell,
floored by the resolution, is the finest comparison the data allow and needs no length.
"""

from __future__ import annotations

import itertools

import torch
from scipy.spatial import cKDTree

from gmmtorch import PointClouds

NEIGHBOURS = 8
"""Cells asked about one point: enough that an elongated cell is not missed because its mean is far."""

CALIBRATION = 20_000
"""Points of a scan whose own distances are looked at."""

STRAY = 3.0
"""A cell is a handful of stray returns when its points are this many times farther apart than those around it."""

SMALLEST = 1e-12
"""Least variance as a share of the scan's, far above rounding and far below any sensor's noise."""

CHUNK = 16_384
"""Points per step, so that no temporary exceeds a few tens of megabytes."""


def surface_distances(points: PointClouds, cells: PointClouds, resolution: torch.Tensor) -> torch.Tensor:
    """Squared Mahalanobis distance of every point to the nearest cell of the other scan, float64 (N,).

    Args:
        points: B clouds of points, m.
        cells: B clouds of cells; row b is the other scan of row b.
        resolution: (B,) m; below it two scans of one surface cannot be told apart. Its square is added to every
            cell's covariance.

    Returns:
        min over nearby cells j of (x - m_j)^T (S_j + r^2 I)^-1 (x - m_j); inf where the other scan is empty.
    """
    spreads = cells.spreads
    if spreads is None:
        spreads = points.points.new_zeros(cells.points.shape[0], cells.dim, cells.dim)
    rows = zip(
        points.split(points.points),
        cells.split(cells.points),
        cells.split(spreads),
        cells.split(cells.weights),
        resolution.tolist(),
        strict=True,
    )
    return torch.cat([_distances(*row) for row in rows])


def _distances(
    points: torch.Tensor, means: torch.Tensor, spreads: torch.Tensor, counts: torch.Tensor, resolution: float
) -> torch.Tensor:
    if not len(means):
        return points.new_full((len(points),), torch.inf)
    surface = _pieces_of_surface(means, spreads, counts)
    means, spreads = means[surface], spreads[surface]
    centre = means.mean(dim=0)  # maps live far from their origin
    points, means = points - centre, means - centre
    floor = _floor(means, spreads, resolution) * torch.eye(means.shape[1], dtype=means.dtype)
    whitener = torch.linalg.inv(torch.linalg.cholesky(spreads + floor))  # (M, 3, 3)
    neighbours = min(NEIGHBOURS, len(means))
    tree = cKDTree(
        means.numpy(), compact_nodes=False, balanced_tree=False
    )  # a fifth faster for points this even
    _, nearest = tree.query(points.numpy(), k=neighbours, workers=-1)
    nearest = torch.from_numpy(nearest).reshape(len(points), neighbours)
    chunks = zip(points.split(CHUNK), nearest.split(CHUNK), strict=True)
    return torch.cat([_nearest(chunk, rows, means, whitener) for chunk, rows in chunks])


def _pieces_of_surface(means: torch.Tensor, spreads: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """Which cells are pieces of a surface, not a few stray returns far from each other, bool (M,).

    A stray cell is wide for its few points, compared with the cells around it; it would vouch for all that it spans.
    """
    neighbours = min(NEIGHBOURS, len(means) - 1)
    if neighbours < 1:
        return torch.ones(len(means), dtype=torch.bool)
    gaps = (spreads.diagonal(dim1=1, dim2=2).sum(dim=1).clamp_min(0) / counts).sqrt()  # (M,)
    centred = (means - means.mean(dim=0)).numpy()
    rows = cKDTree(centred).query(centred, k=neighbours + 1)[1][:, 1:]
    usual = gaps[torch.from_numpy(rows)].median(dim=1).values
    return (gaps <= STRAY * usual) | (usual == 0)


def _floor(means: torch.Tensor, spreads: torch.Tensor, resolution: float) -> float:
    """What is added to every variance, m^2: the resolution's, and where points coincide what rounding needs."""
    extent = float(means.square().sum(dim=1).mean() + spreads.diagonal(dim1=1, dim2=2).sum(dim=1).mean())
    return max(resolution**2, SMALLEST * extent, torch.finfo(means.dtype).tiny)


def _nearest(
    points: torch.Tensor, rows: torch.Tensor, means: torch.Tensor, whitener: torch.Tensor
) -> torch.Tensor:
    offsets = points[:, None, :] - means[rows]  # (n, k, 3)
    white = torch.einsum("nkij,nkj->nki", whitener[rows], offsets)
    return white.square().sum(dim=-1).amin(dim=1)


def own_distances(
    points: PointClouds, cell_of_point: torch.Tensor, resolution: torch.Tensor
) -> tuple[torch.Tensor, ...]:
    """Squared distances that points of a scan keep from a surface they had no part in: those without any change.

    A quarter of the points is measured against cells that the others make, so that no point vouches for itself.

    Args:
        points: B clouds of points, m.
        cell_of_point: int64 (N,), cell of each point, packed over the clouds.
        resolution: (B,) m, see `surface_distances`.

    Returns:
        For each cloud, of about `CALIBRATION` points at most, in ascending order, float64; of none where it has fewer
        than two points.
    """
    held_out = drawn(points, cell_of_point, one_in=4)
    cells = cells_of_members(points, cell_of_point, ~held_out)
    others = _sample(points, held_out)
    distances = others.split(surface_distances(others, cells, resolution))
    return tuple(part[part.isfinite()].sort().values for part in distances)


def chance_of(distances: torch.Tensor, clouds: PointClouds, own: tuple[torch.Tensor, ...]) -> torch.Tensor:
    """Probability of distances (N,) as large without any change, float64 (N,): the conformal p-value.

    (1 + points of the scan itself that are as far from its own surface) / (1 + those looked at); see `own_distances`.
    """
    return torch.cat(
        [
            (1.0 + len(null) - torch.searchsorted(null, part)) / (1.0 + len(null))
            for null, part in zip(own, clouds.split(distances), strict=True)
        ]
    )


def drawn(points: PointClouds, cell_of_point: torch.Tensor, one_in: int) -> torch.Tensor:
    """One in so many points of every cell at random, the same whatever else is in the batch, bool (N,).

    Every second point, say, will not do: in the order of a spinning lidar that is every second beam.
    """
    return torch.cat([_drawn(cells, one_in) for cells in points.split(cell_of_point)])


def _drawn(cells: torch.Tensor, one_in: int) -> torch.Tensor:
    shuffled = torch.randperm(len(cells), generator=torch.Generator().manual_seed(len(cells)))
    by_cell = shuffled[cells[shuffled].argsort(stable=True)]
    chosen = torch.zeros(len(cells), dtype=torch.bool)
    chosen[by_cell[::one_in]] = True
    return chosen


def cells_of_members(points: PointClouds, cell_of_point: torch.Tensor, members: torch.Tensor) -> PointClouds:
    """Means and covariances of the cells from their `members` alone; cells without one are left out."""
    rows, local = cell_of_point[members].unique(return_inverse=True)
    owner = torch.empty_like(rows).scatter_(0, local, points.cloud_index[members])
    counts = torch.bincount(local).to(torch.float64)
    chosen = points.points[members]
    means = torch.zeros(len(rows), 3, dtype=torch.float64).index_add_(0, local, chosen - chosen[:1])
    means = means / counts[:, None] + chosen[:1]
    offsets = chosen - means[local]
    products = (offsets[:, :, None] * offsets[:, None, :]).flatten(1)
    spreads = torch.zeros(len(rows), 9, dtype=torch.float64).index_add_(0, local, products)
    sizes = torch.bincount(owner, minlength=points.batch_size).tolist()
    spreads = (spreads / counts[:, None]).reshape(-1, 3, 3)
    return PointClouds(means, counts, spreads, (0, *itertools.accumulate(sizes)))


def _sample(points: PointClouds, members: torch.Tensor) -> PointClouds:
    """About `CALIBRATION` of the members of each cloud, evenly spaced: a quantile needs no more."""
    chosen = (
        part[picked] for part, picked in zip(points.split(points.points), points.split(members), strict=True)
    )
    return PointClouds.from_list([part[:: max(1, len(part) // CALIBRATION)] for part in chosen])
