"""What of one scan the other does not explain, found before any mixture is fitted.

K_max components describe a room, and a carton that is new in it would be a small part of one of them. So the places
where one scan explains the other worst get components of their own. The cells of simplification are a model of their
scan as fine as its sampling: a cell is unexplained when it is farther from every cell of the other scan, in standard
deviations of both, than cells of an unchanged scan are from each other. Unexplained cells in contact make a component.
Whether it is a novelty is for the detector to say.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import chdtri
from torch import Tensor

from gmmtorch import PointClouds
from novelty.contact import contact_groups
from novelty.detectors.moments import Moments
from novelty.preprocess.prepared import PreparedPairs, PreparedScans

Array = NDArray[np.float64]

FALSE_ALARM = 2e-3
"""Share of unchanged cells that are taken for unexplained."""

LEAST_CELLS = 5
"""Fewer cells in contact get no component: that many are noise, or what EM would starve."""

NEIGHBOURS = 8
"""Cells asked about one cell: enough that an elongated one is not missed because its mean is far."""


SMALLEST = 1e-12
"""Least variance as a share of the scan's squared size, far above rounding and far below any sensor's noise."""


@dataclass(frozen=True, eq=False)
class Unexplained:
    """What the other scan does not explain of each of P scans.

    Attributes:
        cells: bool (N,), over the scans' packed cells.
        groups: (P, E), groups of such cells in contact, the largest first.
    """

    cells: Tensor
    groups: Moments

    def explained(self, clouds: PointClouds) -> PointClouds:
        """The clouds of these cells with no weight where the other scan does not explain them."""
        return replace(clouds, weights=torch.where(self.cells, 0.0, clouds.weights))


def find_unexplained(
    batch: PreparedPairs, clouds: tuple[PointClouds, PointClouds], most_groups: int
) -> tuple[Unexplained, Unexplained]:
    """What the current scans do not explain of the references, and the references of the current scans.

    Args:
        batch: P pairs, in one frame.
        clouds: the cells of the references and of the current scans as they are fitted: what counts how much.
        most_groups: Largest number of groups of a scan; with 0 every cell counts as explained.
    """
    resolution = batch.sampling.tolist()
    found = []
    for row in range(len(batch)):
        one, other = (
            _Cells.of(scans, fitted.split(fitted.weights)[row].numpy(), row, resolution[row])
            for scans, fitted in zip((batch.reference, batch.current), clouds, strict=True)
        )
        found.append((one.unexplained_by(other, most_groups), other.unexplained_by(one, most_groups)))
    return _packed([first for first, _ in found]), _packed([second for _, second in found])


@dataclass(frozen=True, eq=False)
class _Cells:
    """The cells of one scan: counts (n,), means (n, 3) m, covariances (n, 3, 3) m^2, least extent m."""

    counts: Array
    means: Array
    covariances: Array
    least_extent: float

    @classmethod
    def of(cls, scans: PreparedScans, counts: Array, row: int, resolution: float) -> _Cells:
        """The cells of scan `row` with these counts, half the squared resolution added to each covariance."""
        cells = scans.cells
        spreads = cells.spreads if cells.spreads is not None else torch.zeros(len(cells.points), 3, 3)
        means, covariances = (cells.split(v)[row].numpy() for v in (cells.points, spreads))
        size = float(np.ptp(means, axis=0).max()) if len(means) else 0.0
        floor = max(0.5 * resolution**2, SMALLEST * (size or 1.0) ** 2)
        least = max(float(scans.cell_size[row]), float(scans.spacing[row]))
        return cls(counts, means, covariances + floor * np.eye(3), least)

    def unexplained_by(self, other: _Cells, most_groups: int) -> tuple[NDArray[np.bool_], list[_Group]]:
        """Which cells are (n,), and the largest groups of them."""
        if not (most_groups and len(self.means) and len(other.means)):
            return np.zeros(len(self.means), dtype=np.bool_), []
        usual = np.concatenate([self._from(self, 1), other._from(other, 1), [chdtri(3, FALSE_ALARM)]])
        flags = self._from(other) > max(np.quantile(usual, 1 - FALSE_ALARM), usual[-1])
        return flags, self._groups(np.flatnonzero(flags), most_groups)

    def _from(self, other: _Cells, skipped: int = 0) -> Array:
        """Squared Mahalanobis distance of each cell to the nearest others, the first ones skipped (n,)."""
        first, last = skipped, min(skipped + NEIGHBOURS, len(other.means))
        if first >= last:
            return np.empty(0)
        _, rows = cKDTree(other.means).query(
            self.means, k=[*range(first + 1, last + 1)], workers=-1
        )  # (n, k)
        offsets = self.means[:, None] - other.means[rows]
        return _squared_norms(offsets, self.covariances[:, None] + other.covariances[rows]).min(axis=1)

    def _groups(self, chosen: NDArray[np.int64], most: int) -> list[_Group]:
        """Moments of the largest groups in contact of the chosen cells."""
        extents = np.sqrt(np.trace(self.covariances[chosen], axis1=1, axis2=2)).clip(self.least_extent)
        group = contact_groups(self.means[chosen], extents)
        sizes = np.bincount(group)
        largest = np.argsort(-sizes, kind="stable")[:most]
        return [self._moments(chosen[group == g]) for g in largest if sizes[g] >= LEAST_CELLS]

    def _moments(self, members: NDArray[np.int64]) -> _Group:
        counts = self.counts[members]
        total = counts.sum()
        mean = counts @ self.means[members] / total
        offsets = self.means[members] - mean
        squares = self.covariances[members] + offsets[:, :, None] * offsets[:, None, :]
        return total, mean, np.tensordot(counts, squares, 1) / total


_Group = tuple[float, Array, Array]
"""Count, mean (3,) and covariance (3, 3) of a group of cells."""


def _squared_norms(offsets: Array, covariances: Array) -> Array:
    """x^T S^-1 x by cofactors, (..., 3) and (..., 3, 3) -> (...): several times faster than solving."""
    (a, b, c), (_, d, e), (_, _, f) = np.moveaxis(covariances, (-2, -1), (0, 1))
    x, y, z = np.moveaxis(offsets, -1, 0)
    xx, xy, xz = d * f - e * e, c * e - b * f, b * e - c * d
    yy, yz, zz = a * f - c * c, b * c - a * e, a * d - b * b
    form = xx * x * x + yy * y * y + zz * z * z + 2 * (xy * x * y + xz * x * z + yz * y * z)
    return form / (a * xx + b * xy + c * xz)


def _packed(found: list[tuple[NDArray[np.bool_], list[_Group]]]) -> Unexplained:
    """The findings of P scans as one batch."""
    slots = max((len(groups) for _, groups in found), default=0)
    counts = torch.zeros(len(found), slots, dtype=torch.float64)
    means = torch.zeros(len(found), slots, 3, dtype=torch.float64)
    covariances = torch.eye(3, dtype=torch.float64).repeat(len(found), slots, 1, 1)
    for row, (_, groups) in enumerate(found):
        for slot, (count, mean, covariance) in enumerate(groups):
            counts[row, slot] = count
            means[row, slot] = torch.from_numpy(mean)
            covariances[row, slot] = torch.from_numpy(covariance)
    cells = (
        torch.cat([torch.from_numpy(flags) for flags, _ in found])
        if found
        else torch.zeros(0, dtype=torch.bool)
    )
    return Unexplained(cells, Moments(counts, means, covariances))
