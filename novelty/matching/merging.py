"""Merging before matching: components that one fit cut apart and the other did not.

Two fits cut one surface in two different ways. Where one has a component and the other two halves of it, neither half
is like the whole, and what never changed would have no counterpart. So two components become one, by their moments,
where together they are much nearer to a component of the other mixture than any single one is; and again, until
nothing more is to be joined. Both must lie inside that component: the points of its parts are on average as far from
its mean as its own are, in its own standard deviations, and those of a new thing before a wall are not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from novelty.matching.correspondence import Components

NEARER = 0.5
"""The union lies within this share of the distance of the nearest single component."""

INSIDE = 2.0
"""Mean squared distance of a part's points from the whole, in units of that of the whole's own points."""

Distances = Callable[[Components, Components], Tensor]
"""Distances (P, K_a, K_b) between the components of two sides."""


@dataclass(frozen=True)
class Merged:
    """One side of P mixture pairs after merging.

    Attributes:
        components: (P, K); a union stands in the slot of its first member, and the other slots have weight 0.
        groups: int64 (P, K), the slot in which each component is now.
    """

    components: Components
    groups: Tensor

    def spread(self, values: Tensor) -> Tensor:
        """What is known of the slots (P, K, ...) told of the components that they hold (P, K, ...)."""
        index = self.groups.reshape(self.groups.shape + (1,) * (values.ndim - 2))
        return torch.take_along_dim(values, index, dim=1)


def unmerged(side: Components) -> Merged:
    """A side as it is."""
    pairs, K = side.weights.shape
    return Merged(side, torch.arange(K, device=side.weights.device).repeat(pairs, 1))


def merge_cut_components(side: Components, other: Components, distances: Distances) -> Merged:
    """Join the components of `side` that are nearer to one of `other` together than alone.

    Every round joins, in each pair, the two components whose union brings the greatest gain; one number is read back
    per round.

    Args:
        side: K components of each of P mixtures.
        other: K_b components of each of the mixtures that these are to be matched with.
        distances: The ground distance of the match.
    """
    pairs, K = side.weights.shape
    left, right = torch.triu_indices(K, K, 1, device=side.weights.device)
    groups = unmerged(side).groups
    absent = (other.weights <= 0)[:, None, :]
    rows = torch.arange(pairs, device=side.weights.device)
    for _ in range(K - 1):
        alone = distances(side, other).masked_fill((side.weights <= 0)[:, :, None] | absent, torch.inf)
        nearest = alone.amin(1, keepdim=True)  # (P, 1, K_b), to each of the other mixture
        joined = _unions(side, left, right)
        together = distances(joined, other).masked_fill((joined.weights <= 0)[:, :, None] | absent, torch.inf)
        parts = _inside(side, other)
        joins_parts = parts[:, left] & parts[:, right] & (together < NEARER * nearest)
        gain = torch.where(joins_parts, nearest - together, 0.0).nan_to_num(posinf=0.0)
        best, which = gain.amax(2).max(1)  # (P,)
        joins = best > 0
        if not bool(joins.any()):
            break
        kept, dropped = left[which], right[which]
        side = _replaced(side, joined, rows, which, kept, dropped, joins)
        groups = torch.where(joins[:, None] & (groups == dropped[:, None]), kept[:, None], groups)
    return Merged(side, groups)


def _inside(side: Components, other: Components) -> Tensor:
    """Whether the points of each component lie among those of each of the other mixture, bool (P, K, K_b)."""
    precisions = torch.linalg.inv(other.covariances)  # (P, K_b, D, D)
    apart = side.means[:, :, None] - other.means[:, None]
    squared = torch.einsum("pkld,plde,pkle->pkl", apart, precisions, apart)
    squared = squared + torch.einsum("plde,pked->pkl", precisions, side.covariances)
    return squared <= INSIDE * side.means.shape[-1]


def _unions(side: Components, left: Tensor, right: Tensor) -> Components:
    """Moment-matched unions of pairs of components, (P, M); weight 0 where one of the two is absent."""
    w, v = side.weights[:, left], side.weights[:, right]
    total = w + v
    share = torch.where(total > 0, w / total.clamp_min(torch.finfo(w.dtype).tiny), 0.5)[..., None]
    apart = side.means[:, left] - side.means[:, right]
    means = side.means[:, right] + share * apart
    between = (share * (1 - share))[..., None] * apart[..., :, None] * apart[..., None, :]
    within = (
        share[..., None] * side.covariances[:, left] + (1 - share)[..., None] * side.covariances[:, right]
    )
    return Components(torch.where((w > 0) & (v > 0), total, 0.0), means, within + between)


def _replaced(
    side: Components,
    joined: Components,
    rows: Tensor,
    which: Tensor,
    kept: Tensor,
    dropped: Tensor,
    joins: Tensor,
) -> Components:
    """The side with the union `which` (P,) in the slot of its first member, and nothing in that of the other."""
    weights, means, covariances = side.weights.clone(), side.means.clone(), side.covariances.clone()
    at = rows[joins]
    weights[at, kept[joins]] = joined.weights[at, which[joins]]
    weights[at, dropped[joins]] = 0.0
    means[at, kept[joins]] = joined.means[at, which[joins]]
    covariances[at, kept[joins]] = joined.covariances[at, which[joins]]
    return Components(weights, means, covariances)
