"""Which piece of surface of the reference each piece of the current scan lies on, and how far off it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from novelty.registration.motion import Motions
from novelty.registration.surfels import Surfels

REACH = 2.0
"""Two patches of one surface lie at most this many extents of both from each other, along the surface."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched surfels of P pairs, packed; M of them.

    Attributes:
        owner: int64 (M,), pair.
        current: int64 (M,), row of the current surfels.
        reference: int64 (M,), row of the reference surfels.
        positions: (M, 3), the current surfels' means after the motion, m.
        differences: (M, 3), position minus the reference surfel's mean, m.
        information: (M, 3, 3), (R A R^T + B)^-1, 1/m^2.
        trace: (M,), tr(information).
        squared: (M,), differences^T information differences.
    """

    owner: torch.Tensor
    current: torch.Tensor
    reference: torch.Tensor
    positions: torch.Tensor
    differences: torch.Tensor
    information: torch.Tensor
    trace: torch.Tensor
    squared: torch.Tensor

    @property
    def across(self) -> torch.Tensor:
        """Distance across the surface, (M,), m."""
        return torch.sqrt(self.squared / self.trace)

    def select(self, rows: torch.Tensor) -> Matches:
        """The matches at `rows`."""
        return Matches(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


class Matcher:
    """Finds the nearest reference surfel of every current one; one search tree per pair."""

    def __init__(self, current: Surfels, reference: Surfels) -> None:
        """Build the trees."""
        self.current, self.reference = current, reference
        parts = reference.means.split(reference.sizes)
        self._trees = [cKDTree(part.numpy()) if len(part) else None for part in parts]
        self._starts = np.cumsum([0, *reference.sizes])

    def merged(self, limit: int) -> Matcher:
        """The same search among coarser surfels, about `limit` per scan."""
        return Matcher(self.current.merged(limit), self.reference.merged(limit))

    def match(self, motions: Motions) -> Matches:
        """Match every current surfel of the pairs whose reference has any."""
        moved = motions.apply(self.current.means, self.current.owner)
        nearest = self._nearest(moved)
        rows = torch.nonzero(nearest >= 0)[:, 0]
        partners, owner = nearest[rows], self.current.owner[rows]
        differences = moved[rows] - self.reference.means[partners]
        turned = motions.turn(self.current.shapes[rows], owner)
        information = torch.linalg.inv(turned + self.reference.shapes[partners])
        squared = ((information @ differences[:, :, None])[:, :, 0] * differences).sum(-1)
        trace = information.diagonal(dim1=1, dim2=2).sum(-1)
        return Matches(
            owner, rows, partners, moved[rows], differences, information, trace, squared.clamp_min(0)
        )

    def _nearest(self, moved: torch.Tensor) -> torch.Tensor:
        """Row of the nearest reference surfel, int64 (N,), -1 none."""
        found = []
        for tree, start, queries in zip(
            self._trees, self._starts[:-1], moved.split(self.current.sizes), strict=True
        ):
            if tree is None:
                found.append(torch.full((len(queries),), -1))
            else:
                found.append(torch.from_numpy(tree.query(queries.numpy(), workers=-1)[1] + start))
        return torch.cat(found).long()

    def within_reach(self, matches: Matches, across: torch.Tensor) -> torch.Tensor:
        """Whether the two surfels can be of one surface that is displaced by `across` (P,), m; bool (M,)."""
        extents = self.current.extents[matches.current] + self.reference.extents[matches.reference]
        return matches.differences.norm(dim=-1) <= REACH * extents + across[matches.owner]

    def support(self, matches: Matches) -> torch.Tensor:
        """Effective number of points behind each match, (M,)."""
        own, other = self.current.counts[matches.current], self.reference.counts[matches.reference]
        return own * other / (own + other)

    def noise(self, matches: Matches) -> torch.Tensor:
        """Variance of `across` that sensor noise explains, (M,), m^2.

        The mean of n points scatters by thickness^2 / n across the surface. The reference's plane is read beside
        its mean, where its tilt adds as much again.
        """
        own, other = matches.current, matches.reference
        return (
            self.current.thickness[own] ** 2 / self.current.counts[own]
            + 2 * self.reference.thickness[other] ** 2 / self.reference.counts[other]
        )
