"""Which way the surface patches face that the cells of a scan are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gmmtorch import PointClouds
from novelty.preprocess import PreparedScans
from novelty.visibility.rays import STEEPEST

LEAST_PATCH = 4
"""Points through which a plane is a measurement: three always have one."""

AROUND = (8, 32, 128)
"""Cells around one that show how the surface goes on where that cell is a piece of a single scan line; more of them
where so many lie on the same line."""

CHUNK = 2**18
"""Cells per step, each as often as it is around another, so that no temporary exceeds some tens of megabytes."""

ON_LINE = 3
"""Cells, nearest to each other, that show how a line runs."""


def patch_normals(scans: PreparedScans, asked: torch.Tensor) -> torch.Tensor:
    """Unit normals, float64 (M, 3), of the patches `asked` for, bool (M,); NaN elsewhere and of too few points.

    A sensor with far fewer lines than points on each leaves cells that are pieces of one line, whose least extent is
    across the fan of the sensor's own rays. What faces so could not have been seen: such a cell is taken together with
    as many around it, on other lines too, as lie in a plane. Where there is none it has the normal zero if it is a line
    indeed: all that is known of its surface is that the sensor saw it. A sheet along the rays, of returns that were
    mixed at an edge, keeps what it has.
    """
    cells = scans.cells
    normals = torch.full_like(cells.points, torch.nan)
    for patches, origins, chosen, own in zip(
        _patches(scans), _places(scans), cells.split(asked), cells.split(normals), strict=True
    ):
        rows = np.flatnonzero(chosen.numpy() & (patches.weights >= LEAST_PATCH))
        if not len(rows):
            continue
        found = patches.own_normals(rows)
        if len(origins):
            lines = ~_could_be_seen(patches.points[rows], found, origins)
            joint = patches.joint_normals(rows[lines], origins)
            alone = np.isnan(joint[:, 0])
            joint[alone] = found[lines][alone]
            joint[alone & patches.along_lines(rows[lines], origins)] = 0.0
            found[lines] = joint
        own[rows] = torch.from_numpy(found)
    return normals


def filled_between_lines(scans: PreparedScans) -> PointClouds:
    """The cells of B scans, those that are pieces of one scan line widened to the surface that they are drawn from.

    Nothing was measured between the lines of a sensor, and yet a wall goes on there. A piece of a line that lies in a
    plane with those around it stands for all points of that plane that are nearer to its own line than to the next:
    these spread over `gap`, uniformly, which adds gap^2 / 12 to its variance across the line. Without the places the
    sensor stood at a cell is as it is: which way a line faces cannot be told.
    """
    cells = scans.cells
    if cells.spreads is None:
        return cells
    spreads = cells.spreads.clone()
    for patches, origins, own in zip(_patches(scans), _places(scans), cells.split(spreads), strict=True):
        if not len(origins) or len(patches.points) < 2:
            continue
        rows = np.arange(len(patches.points))
        lines = rows[~_could_be_seen(patches.points, patches.own_normals(rows), origins)]
        normals = patches.joint_normals(lines, origins)
        flat = ~np.isnan(normals[:, 0])
        lines, normals = lines[flat], normals[flat]
        if len(lines):
            own[lines] += torch.from_numpy(patches.gaps(lines, normals))
    return PointClouds(cells.points, cells.weights, spreads, cells.offsets)


@dataclass(frozen=True, eq=False)
class _Patches:
    """The M cells of one scan, as small Gaussians.

    Attributes:
        points: (M, 3) means, m.
        weights: (M,) points in each.
        spreads: (M, 3, 3) covariances, m^2.
    """

    points: NDArray[np.float64]
    weights: NDArray[np.float64]
    spreads: NDArray[np.float64]

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.points)

    def near(self, rows: NDArray[np.intp], count: int) -> NDArray[np.intp]:
        """The cells nearest to each of `rows`, itself first, (m, count) or as many as there are."""
        ranks = [*range(1, min(count, len(self.points)) + 1)]
        return self.tree.query(self.points[rows], k=ranks)[1]

    def own_normals(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Directions of the least extent, (m, 3)."""
        return np.linalg.eigh(self.spreads[rows]).eigenvectors[:, :, 0]

    def joint_normals(self, rows: NDArray[np.intp], origins: NDArray[np.float64]) -> NDArray[np.float64]:
        """Normals, (m, 3), of the planes in which cells lie with as few around them as have one; NaN where none do."""
        normals = np.full((len(rows), 3), np.nan)
        left = np.arange(len(rows))
        for around in AROUND:
            if not len(left):
                break
            variances, axes = np.linalg.eigh(self.joint_spreads(self.near(rows[left], around + 1)))
            flat = variances[:, 0] * STEEPEST**2 < variances[:, 1]
            found = flat & _could_be_seen(self.points[rows[left]], axes[:, :, 0], origins)
            normals[left[found]] = axes[found, :, 0]
            left = left[~found]
        return normals

    def along_lines(self, rows: NDArray[np.intp], origins: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether cells and the nearest to them make a line that runs across the rays to it (m,)."""
        variances, axes = np.linalg.eigh(self.joint_spreads(self.near(rows, ON_LINE)))
        straight = variances[:, 1] * STEEPEST**2 < variances[:, 2]
        away = self.points[rows] - origins[:, None]
        cosines = np.abs(np.einsum("smd,md->sm", away, axes[:, :, 2])) / np.linalg.norm(away, axis=2)
        return straight & (cosines < STEEPEST / np.hypot(1, STEEPEST)).all(axis=0)

    def joint_spreads(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Covariances of groups of k cells taken together: (m, k) -> (m, 3, 3), m^2."""
        steps = 1 + rows.size // CHUNK
        return np.concatenate([self._joint_spreads(part) for part in np.array_split(rows, steps)])

    def _joint_spreads(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        weights = self.weights[rows]
        shares = weights / weights.sum(axis=1, keepdims=True)
        offsets = self.points[rows] - np.einsum("mk,mkd->md", shares, self.points[rows])[:, None]
        inside = np.einsum("mk,mkde->mde", shares, self.spreads[rows])
        return inside + np.einsum("mk,mkd,mke->mde", shares, offsets, offsets, optimize=True)

    def gaps(self, rows: NDArray[np.intp], normals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariances, (m, 3, 3), of what lies between the line of each cell and the next in its plane, m^2.

        Zero where no other line is among the cells around.
        """
        on_line = self.joint_spreads(self.near(rows, ON_LINE))
        in_plane = np.eye(3) - normals[:, :, None] * normals[:, None, :]
        along = np.linalg.eigh(in_plane @ on_line @ in_plane).eigenvectors[:, :, 2]
        across = np.cross(normals, along)
        offsets = self.points[self.near(rows, AROUND[-1] + 1)] - self.points[rows][:, None]  # (m, k, 3)
        up, ahead, aside = (
            np.abs(np.einsum("mkd,md->mk", offsets, axis)) for axis in (normals, along, across)
        )
        other_line = (aside > ahead) & (aside > STEEPEST * up)
        gap = np.where(other_line, aside, np.inf).min(axis=1)
        variance = np.where(np.isfinite(gap), gap, 0.0) ** 2 / 12
        return variance[:, None, None] * across[:, :, None] * across[:, None, :]


def _patches(scans: PreparedScans) -> Iterator[_Patches]:
    cells = scans.cells
    spreads = (
        torch.zeros(len(cells.points), 3, 3, dtype=torch.float64) if cells.spreads is None else cells.spreads
    )
    for parts in zip(*map(cells.split, (cells.points, cells.weights, spreads)), strict=True):
        yield _Patches(*(part.numpy() for part in parts))


def _places(scans: PreparedScans) -> Iterator[NDArray[np.float64]]:
    """For each scan the places where its sensor stood, (s, 3) m; none where they are not known."""
    for stations in scans.stations:
        yield np.array([rays.origin for rays in stations]).reshape(-1, 3)


def _could_be_seen(
    points: NDArray[np.float64], normals: NDArray[np.float64], origins: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether patches (n, 3) lean `STEEPEST` at most against a ray from one of the places (s, 3) to them (n,)."""
    away = points - origins[:, None]  # (s, n, 3)
    cosines = np.abs(np.einsum("snd,nd->sn", away, normals))
    return (cosines * np.hypot(1, STEEPEST) >= np.linalg.norm(away, axis=2)).any(axis=0)
