"""Which way the surface patches face that the cells of a scan are."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from novelty.preprocess import PreparedScans
from novelty.visibility.rays import STEEPEST

LEAST_PATCH = 4
"""Points through which a plane is a measurement: three always have one."""

AROUND = (8, 32, 128)
"""Cells around one that show how the surface goes on where that cell is a piece of a single scan line; more of them
where so many lie on the same line."""


def patch_normals(scans: PreparedScans) -> torch.Tensor:
    """Unit normals of the patches, float64 (M, 3); NaN where too few points make one.

    A sensor with far fewer lines than points on each leaves cells that are pieces of one line, whose least extent is
    across the fan of the sensor's own rays. What faces so could not have been seen: such a cell is taken together with
    as many around it, on other lines too, as lie in a plane; where there is none it keeps what it has.
    """
    cells = scans.cells
    if cells.spreads is None:
        return torch.full_like(cells.points, torch.nan)
    normals = _least_axes(cells.spreads.numpy())
    packed = (cells.weights, cells.points, cells.spreads, torch.from_numpy(normals))
    for stations, *parts in zip(scans.stations, *map(cells.split, packed), strict=True):
        weights, points, spreads, own = (part.numpy() for part in parts)
        if stations and len(points):
            origins = np.stack([rays.origin for rays in stations])
            unseen = np.flatnonzero(~_could_be_seen(points, own, origins))
            for around in AROUND:
                variances, axes = np.linalg.eigh(_spreads_around(points, weights, spreads, unseen, around))
                flat = variances[:, 0] * STEEPEST**2 < variances[:, 1]
                found = flat & _could_be_seen(points[unseen], axes[:, :, 0], origins)
                own[unseen[found]] = axes[found, :, 0]
                unseen = unseen[~found]
    return torch.where((cells.weights >= LEAST_PATCH)[:, None], torch.from_numpy(normals), torch.nan)


def _least_axes(spreads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes (n, 3) along which covariances (n, 3, 3) are least."""
    return np.linalg.eigh(spreads)[1][:, :, 0]


def _could_be_seen(
    points: NDArray[np.float64], normals: NDArray[np.float64], origins: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether patches (n, 3) lean `STEEPEST` at most against a ray from one of the places (s, 3) to them (n,)."""
    away = points - origins[:, None]  # (s, n, 3)
    cosines = np.abs(np.einsum("snd,nd->sn", away, normals))
    return (cosines * np.hypot(1, STEEPEST) >= np.linalg.norm(away, axis=2)).any(axis=0)


def _spreads_around(
    points: NDArray[np.float64],
    weights: NDArray[np.float64],
    spreads: NDArray[np.float64],
    chosen: NDArray[np.int64],
    around: int,
) -> NDArray[np.float64]:
    """Covariances of the chosen cells (m,) together with as many nearest ones (m, 3, 3), m^2."""
    if not len(chosen):
        return spreads[:0]
    _, rows = cKDTree(points).query(points[chosen], k=[*range(1, min(around + 1, len(points)) + 1)])
    shares = weights[rows] / weights[rows].sum(axis=1, keepdims=True)  # (m, k)
    centres = np.einsum("mk,mkd->md", shares, points[rows])
    offsets = points[rows] - centres[:, None]
    outer = spreads[rows] + offsets[..., :, None] * offsets[..., None, :]
    return np.einsum("mk,mkde->mde", shares, outer)
