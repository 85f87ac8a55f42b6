"""The initialiser `merged`: a fine partition of the cloud, joined again until K components are left.

A cloud is cut by planes into many small groups (binary space partition; Pauly, Gross & Kobbelt 2002), always where
the scatter along the main axis is greatest, and the pair of groups whose union costs least by eq. 7 is joined until K
groups are left. What belongs together, a wall or an object, starts as one component with its own weight and
covariance. No random number is drawn, and the order of the points does not matter beyond rounding.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.clouds import PointClouds

__all__ = ["merged_groups"]

_GROUPS_PER_COMPONENT = 6
"""Groups that are cut for each component wanted; more changes little and costs the square of it."""

_MOST_POINTS = 16_384
"""Points of a cloud that are partitioned, evenly in their order; more tell little about so few groups."""

_THICKNESS = 1e-4
"""Least standard deviation of a group as a share of the cloud's extent: keeps exact planes comparable."""


class Groups(NamedTuple):
    """Moments of G groups of every cloud: weights (B, G), means (B, G, D), covariances (B, G, D, D)."""

    weights: Tensor
    means: Tensor
    covariances: Tensor


def merged_groups(clouds: PointClouds, num_components: Sequence[int]) -> Groups:
    """Moments of K groups of every cloud; the weights of a cloud sum to 1.

    Args:
        clouds: the batch, normalised to an extent of about 1.
        num_components: K of every cloud (B,). Slots from there on have weight 0, and so have some before it in a
            cloud that has fewer different points.
    """
    slots = max(1, *num_components)
    batch, dim = clouds.batch_size, clouds.dim
    found = Groups(
        clouds.points.new_zeros(batch, slots),
        clouds.points.new_zeros(batch, slots, dim),
        torch.eye(dim, dtype=torch.float64, device=clouds.device).repeat(batch, slots, 1, 1),
    )
    # The partition depends on K: clouds of one K at a time, so that the others of the batch have no say.
    for order in sorted(set(num_components)):
        members = [b for b, k in enumerate(num_components) if k == order]
        for all_groups, groups in zip(found, _merged(clouds.select(members), order), strict=True):
            all_groups[members, : groups.shape[1]] = groups
    return found


def _merged(clouds: PointClouds, order: int) -> Groups:
    """Moments of `order` groups of every cloud, at least one slot."""
    slots = max(1, order)
    groups = _partition(_sampled(clouds), _GROUPS_PER_COMPONENT * slots)
    thickness = _THICKNESS**2 * torch.eye(clouds.dim, dtype=torch.float64, device=clouds.device)
    groups = groups._replace(covariances=groups.covariances + thickness)
    groups = _join(groups, order)
    first = torch.argsort((groups.weights <= 0).to(torch.int8), dim=1, stable=True)[:, :slots]
    weights = torch.take_along_dim(groups.weights, first, 1)
    return Groups(
        weights / weights.sum(1, keepdim=True).clamp_min(torch.finfo(weights.dtype).tiny),
        torch.take_along_dim(groups.means, first[..., None], 1),
        torch.take_along_dim(groups.covariances, first[..., None, None], 1),
    )


def _sampled(clouds: PointClouds) -> PointClouds:
    """The same clouds with every second, third, ... point of those that have more than enough."""
    bounds = list(itertools.pairwise(clouds.offsets))
    if max(last - first for first, last in bounds) <= _MOST_POINTS:
        return clouds
    kept = [torch.arange(first, last, -(-(last - first) // _MOST_POINTS) or 1) for first, last in bounds]
    rows = torch.cat(kept).to(clouds.device)
    offsets = (0, *itertools.accumulate(len(points) for points in kept))
    spreads = None if clouds.spreads is None else clouds.spreads[rows]
    return PointClouds(clouds.points[rows], clouds.weights[rows], spreads, offsets, clouds.dtype)


def _partition(clouds: PointClouds, num_groups: int) -> Groups:
    """Cut every cloud into groups by planes through their means, across their main axes."""
    owner = clouds.cloud_index
    group = torch.zeros_like(owner)  # (N,), within its cloud
    count = 1
    while count < num_groups:
        # Half of the groups at a time: those with the greatest scatter along their main axis.
        cuts = min((count + 1) // 2, num_groups - count)
        place = owner * count + group
        moments = _moments(clouds, place, count, clouds.spreads is not None)
        variances, axes = torch.linalg.eigh(moments.covariances)
        axis = _pointing_ahead(axes[..., -1])
        scatter = moments.weights * variances[..., -1]
        rank = torch.argsort(torch.argsort(scatter, dim=1, descending=True, stable=True), dim=1)  # (B, G)
        offset = clouds.points - moments.means.flatten(0, 1)[place]
        beyond = (offset * axis.flatten(0, 1)[place]).sum(1) > 0
        cut = rank.flatten()[place]
        group = torch.where(beyond & (cut < cuts), count + cut, group)
        count += cuts
    return _moments(clouds, owner * count + group, count)


def _pointing_ahead(axes: Tensor) -> Tensor:
    """Axes (..., D) in the half-space of one fixed direction: an eigenvector has no sign, and groups need an order.

    The direction is oblique, so that the axes of rooms and of squares in them do not lie on its border.
    """
    oblique = 0.618 ** torch.arange(axes.shape[-1], dtype=axes.dtype, device=axes.device)
    return torch.where((axes * oblique).sum(-1, keepdim=True) < 0, -axes, axes)


def _moments(clouds: PointClouds, place: Tensor, count: int, between_only: bool = False) -> Groups:
    """Moments of the groups b G + g that the points (N,) are in; of the cells' means alone if `between_only`."""
    total, dim = clouds.batch_size * count, clouds.dim
    points, mass = clouds.points, clouds.weights
    weights = points.new_zeros(total).index_add_(0, place, mass)
    safe = torch.where(weights > 0, weights, 1.0)
    means = points.new_zeros(total, dim).index_add_(0, place, mass[:, None] * points) / safe[:, None]
    offset = points - means[place]
    second = linalg.pack_symmetric(offset[:, :, None] * offset[:, None, :])
    if clouds.spreads is not None and not between_only:
        second = second + linalg.pack_symmetric(clouds.spreads)
    packed = points.new_zeros(total, second.shape[1]).index_add_(0, place, mass[:, None] * second)
    covariances = linalg.unpack_symmetric(packed / safe[:, None], dim)
    return Groups(
        weights.unflatten(0, (-1, count)),
        means.unflatten(0, (-1, count)),
        covariances.unflatten(0, (-1, count)),
    )


def _join(groups: Groups, wanted: int) -> Groups:
    """Join the pair of least cost (eq. 7) until every cloud has `wanted` groups."""
    batch, count = groups.weights.shape
    rows = torch.arange(batch, device=groups.weights.device)
    slots = torch.arange(count, device=groups.weights.device)
    log_dets = _log_determinants(groups.covariances)
    costs = torch.stack(
        [_union_costs(groups, log_dets, slots.new_full((batch,), g)) for g in range(count)], 1
    )
    for _ in range(count - wanted):
        going_on = (groups.weights > 0).sum(1) > wanted  # (B,)
        pair = costs.flatten(1).argmin(1)  # the first of equals
        kept, gone = pair // count, pair % count
        union = _union(groups, kept, slots[None].expand(batch, -1))
        here = (slots == kept[:, None]) & going_on[:, None]  # (B, G)
        away = (slots == gone[:, None]) & going_on[:, None]
        groups = Groups(
            torch.where(away, 0.0, torch.where(here, union.weights[rows, gone][:, None], groups.weights)),
            torch.where(here[..., None], union.means[rows, gone][:, None], groups.means),
            torch.where(here[..., None, None], union.covariances[rows, gone][:, None], groups.covariances),
        )
        log_dets = torch.where(here, _log_determinants(union.covariances[rows, gone])[:, None], log_dets)
        renewed = _union_costs(groups, log_dets, kept)
        costs = torch.where(here[:, :, None], renewed[:, None, :], costs)
        costs = torch.where(here[:, None, :], renewed[:, :, None], costs)
        costs = torch.where(away[:, :, None] | away[:, None, :], torch.inf, costs)
    return groups


def _union_costs(groups: Groups, log_dets: Tensor, slot: Tensor) -> Tensor:
    """d(l, m) of eq. 7 between group `slot` (B,) and every other one (B, G), per unit of N; inf where there is none."""
    rows = torch.arange(len(slot), device=slot.device)
    slots = torch.arange(groups.weights.shape[1], device=slot.device)
    union = _log_determinants(_union(groups, slot, slots[None].expand(len(slot), -1)).covariances)
    own = groups.weights[rows, slot][:, None]
    cost = own * (union - log_dets[rows, slot][:, None]) + groups.weights * (union - log_dets)
    valid = (own > 0) & (groups.weights > 0) & (slots != slot[:, None])
    return torch.where(valid, 0.5 * cost, torch.inf)


def _union(groups: Groups, slot: Tensor, others: Tensor) -> Groups:
    """Moments of the union of group `slot` (B,) with each of `others` (B, G)."""
    rows = torch.arange(len(slot), device=slot.device)
    own = groups.weights[rows, slot][:, None]
    theirs = torch.take_along_dim(groups.weights, others, 1)
    weights = own + theirs
    share = (theirs / torch.where(weights > 0, weights, 1.0))[..., None]
    first = groups.means[rows, slot][:, None]
    apart = torch.take_along_dim(groups.means, others[..., None], 1) - first
    within = (1 - share[..., None]) * groups.covariances[rows, slot][:, None] + share[
        ..., None
    ] * torch.take_along_dim(groups.covariances, others[..., None, None], 1)
    between = (share * (1 - share))[..., None] * apart[..., :, None] * apart[..., None, :]
    return Groups(weights, first + share * apart, within + between)


def _log_determinants(covariances: Tensor) -> Tensor:
    return linalg.log_determinant(linalg.safe_cholesky(covariances)[0])
