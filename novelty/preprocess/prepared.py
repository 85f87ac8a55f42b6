"""What preprocessing hands on: cells to fit, the points behind them, and the way back to the scan as given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from gmmtorch import PointClouds
from novelty.preprocess.ground import NoGround, Plane

if TYPE_CHECKING:
    from novelty.visibility.rays import Rays


@dataclass(frozen=True, eq=False)
class PreparedScans:
    """B scans after preprocessing, packed; every length is in metres.

    A scan that left nothing to examine keeps its place as an empty cloud.

    Attributes:
        cells: B clouds of cells (count, mean, spread), ordered by their smallest original index.
        points: B clouds of the examined points of the given scans, in scan order; N points in all.
        cell_of_point: int64 (N,), row of `cells.points` that holds each examined point.
        kept: For each scan, int64 (N_b,), the place of its examined points in the scan as given.
        num_given: For each scan, the number of points given.
        origins: For each scan, where the sensor stood, (3,) or for each return (M_b, 3); None when unknown.
        returns: For each scan, every finite point given, (M_b, 3) m: what its rays met, examined or not.
        dropped: For each scan, how many points each step took out (`not finite`, `cropped`, `outlier`, `ground`).
        spacing: float64 (B,), typical distance between neighbouring points, m; NaN for an empty cloud.
        cell_size: float64 (B,), typical root-mean-square extent of a cell, m; NaN for an empty cloud.
        notes: For each scan, what a reader of the result must know (substitutions, oddities).
        grounds: For each scan, the plane whose points were taken out, or why none was, m.
    """

    cells: PointClouds
    points: PointClouds
    cell_of_point: torch.Tensor
    kept: tuple[NDArray[np.int64], ...]
    num_given: tuple[int, ...]
    origins: tuple[NDArray[np.float64] | None, ...]
    returns: tuple[NDArray[np.float64], ...]
    dropped: tuple[dict[str, int], ...]
    spacing: torch.Tensor
    cell_size: torch.Tensor
    notes: tuple[tuple[str, ...], ...] = field(default=())
    grounds: tuple[Plane | NoGround, ...] = field(default=())

    def __len__(self) -> int:
        """B."""
        return len(self.kept)

    @cached_property
    def stations(self) -> tuple[tuple[Rays, ...], ...]:
        """For each scan its rays from each place of its sensor, see `stations_of`; made once for all who ask."""
        from novelty.visibility.rays import stations_of

        return tuple(stations_of(*given) for given in zip(self.returns, self.origins, strict=True))

    def select(self, indices: Sequence[int]) -> PreparedScans:
        """The scans at `indices`, in that order; an index may repeat."""
        local = self.cell_of_point - _starts(self.cells)[self.points.cloud_index]
        cells, points = self.cells.select(indices), self.points.select(indices)
        pieces = [self.points.split(local)[index] for index in indices]
        packed = torch.cat(pieces) if pieces else local[:0]
        rows = torch.tensor(indices, dtype=torch.long)
        return PreparedScans(
            cells=cells,
            points=points,
            cell_of_point=packed + _starts(cells)[points.cloud_index],
            kept=tuple(self.kept[index] for index in indices),
            num_given=tuple(self.num_given[index] for index in indices),
            origins=tuple(self.origins[index] for index in indices),
            returns=tuple(self.returns[index] for index in indices),
            dropped=tuple(self.dropped[index] for index in indices),
            spacing=self.spacing[rows],
            cell_size=self.cell_size[rows],
            notes=tuple(self.notes[index] for index in indices),
            grounds=tuple(self.grounds[index] for index in indices),
        )

    def moved(self, transforms: torch.Tensor) -> PreparedScans:
        """The scans in other frames: row b by the rigid motion `transforms[b]`, float64 (B, 4, 4), m."""
        rotations = transforms[:, :3, :3]
        motions = transforms.numpy()
        turn = rotations[self.cells.cloud_index]
        spreads = None if self.cells.spreads is None else turn @ self.cells.spreads @ turn.mT
        return replace(
            self,
            cells=replace(self.cells, points=_moved(self.cells, transforms), spreads=spreads),
            points=replace(self.points, points=_moved(self.points, transforms)),
            origins=tuple(
                None if origin is None else _apply(motion, origin)
                for origin, motion in zip(self.origins, motions, strict=True)
            ),
            returns=tuple(
                _apply(motion, points) for points, motion in zip(self.returns, motions, strict=True)
            ),
        )


@dataclass(frozen=True, eq=False)
class PreparedPairs:
    """P pairs of prepared scans: row p of `reference` is compared with row p of `current`.

    Attributes:
        misalignment: (P,) m, what registration left of the error of the pose, NaN where it is not known; None before.
    """

    reference: PreparedScans
    current: PreparedScans
    misalignment: torch.Tensor | None = None

    def __len__(self) -> int:
        """P."""
        return len(self.reference)

    def exchanged(self) -> PreparedPairs:
        """The same pairs with the roles exchanged: what is new there is gone here."""
        return PreparedPairs(self.current, self.reference, self.misalignment)

    def aligned(self, transforms: torch.Tensor, misalignment: torch.Tensor) -> PreparedPairs:
        """The same pairs with the current scans moved into the frames of the references.

        Args:
            transforms: float64 (P, 4, 4), m.
            misalignment: (P,) m, what is left of the error of the pose.
        """
        return PreparedPairs(self.reference, self.current.moved(transforms), misalignment)

    @property
    def sampling(self) -> torch.Tensor:
        """Typical distance between neighbouring points in the coarser scan of each pair, m (P,); 0 where unknown."""
        return torch.fmax(self.reference.spacing, self.current.spacing).nan_to_num(0.0)

    @property
    def resolution(self) -> torch.Tensor:
        """Length below which the two scans of a pair cannot be told apart, m (P,): sampling and pose error together."""
        return self.with_misalignment(self.sampling)

    def with_misalignment(self, lengths: torch.Tensor) -> torch.Tensor:
        """Standard deviations (P,) m of either scan, with the error of the pose between them; unknown is none."""
        if self.misalignment is None:
            return lengths
        return torch.hypot(lengths, self.misalignment.nan_to_num(0.0))


def _starts(clouds: PointClouds) -> torch.Tensor:
    return torch.tensor(clouds.offsets[:-1], device=clouds.device)


def _moved(clouds: PointClouds, transforms: torch.Tensor) -> torch.Tensor:
    motion = transforms[clouds.cloud_index]  # (N, 4, 4)
    return (motion[:, :3, :3] @ clouds.points[:, :, None])[:, :, 0] + motion[:, :3, 3]


def _apply(motion: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (..., 3) after the rigid motion (4, 4)."""
    return points @ motion[:3, :3].T + motion[:3, 3]
