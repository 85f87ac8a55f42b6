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


def patch_normals(scans: PreparedScans, asked: torch.Tensor) -> torch.Tensor:
    """Unit normals, float64 (M, 3), of the patches `asked` for, bool (M,); NaN elsewhere or of too few points.

    A sensor with far fewer lines than points on each leaves cells that are pieces of one line, whose least extent is
    across the fan of the sensor's own rays. What faces so could not have been seen: such a cell is taken together with
    as many around it, on other lines too, as lie in a plane; where there is none it keeps what it has.
    """
    cells = scans.cells
    if cells.spreads is None:
        return torch.full_like(cells.points, torch.nan)
    known = asked & (cells.weights >= LEAST_PATCH)
    normals = torch.full_like(cells.points, torch.nan)
    normals[known] = torch.linalg.eigh(cells.spreads[known]).eigenvectors[:, :, 0]  # of the least eigenvalue
    packed = (cells.weights, cells.points, cells.spreads, known, normals)
    for stations, *parts in zip(scans.stations, *map(cells.split, packed), strict=True):
        weights, points, spreads, chosen, own = (part.numpy() for part in parts)
        if stations and chosen.any():
            origins = np.stack([rays.origin for rays in stations])
            rows = np.flatnonzero(chosen)
            unseen = rows[~_could_be_seen(points[rows], own[rows], origins)]
            tree = cKDTree(points)
            for around in AROUND:
                if not len(unseen):
                    break
                _, near = tree.query(points[unseen], k=[*range(1, min(around + 1, len(points)) + 1)])
                variances, axes = np.linalg.eigh(_joint_spreads(points[near], weights[near], spreads[near]))
                flat = variances[:, 0] * STEEPEST**2 < variances[:, 1]
                found = flat & _could_be_seen(points[unseen], axes[:, :, 0], origins)
                own[unseen[found]] = axes[found, :, 0]
                unseen = unseen[~found]
    return normals


def _could_be_seen(
    points: NDArray[np.float64], normals: NDArray[np.float64], origins: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether patches (n, 3) lean `STEEPEST` at most against a ray from one of the places (s, 3) to them (n,)."""
    away = points - origins[:, None]  # (s, n, 3)
    cosines = np.abs(np.einsum("snd,nd->sn", away, normals))
    return (cosines * np.hypot(1, STEEPEST) >= np.linalg.norm(away, axis=2)).any(axis=0)


def _joint_spreads(
    points: NDArray[np.float64], weights: NDArray[np.float64], spreads: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Covariances of groups of k cells taken together: (m, k, 3), (m, k), (m, k, 3, 3) -> (m, 3, 3), m^2."""
    shares = weights / weights.sum(axis=1, keepdims=True)
    offsets = points - np.einsum("mk,mkd->md", shares, points)[:, None]
    squares = spreads + offsets[..., :, None] * offsets[..., None, :]
    return np.einsum("mk,mkde->mde", shares, squares)
