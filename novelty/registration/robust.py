"""Robust statistics of packed values: a share of the matches is wrong because something has changed."""

from __future__ import annotations

import torch

from novelty.registration.matching import REACH, Matcher, Matches

WIDTH = 3.0
"""c in robust standard deviations of the residuals."""

NORMAL_MEDIAN = 0.6745
"""Median of |x| for a standard normal x."""

BIWEIGHT, HALF = 1.547, 0.5
"""Tukey's constant and mean value that make the M-scale withstand half of the values and agree with normal ones."""


def group_sum(values: torch.Tensor, owner: torch.Tensor, groups: int) -> torch.Tensor:
    """Sums (P, ...) of packed values (M, ...) over their groups (M,)."""
    return values.new_zeros(groups, *values.shape[1:]).index_add_(0, owner, values)


def group_quantile(values: torch.Tensor, owner: torch.Tensor, groups: int, share: float) -> torch.Tensor:
    """The value below which a `share` of each group lies, (P,); NaN for an empty group."""
    order = torch.argsort(values)
    order = order[torch.argsort(owner[order], stable=True)]
    counts = torch.bincount(owner, minlength=groups)
    place = counts.cumsum(0) - counts + (share * (counts - 1)).clamp_min(0).long()
    padded = torch.cat([values[order], values.new_full((1,), torch.nan)])
    return torch.where(counts > 0, padded[place.clamp_max(len(values))], torch.nan)


def scale_of(values: torch.Tensor, owner: torch.Tensor, groups: int) -> torch.Tensor:
    """Robust standard deviation of each group about 0 by an M-scale, (P,); NaN for an empty group.

    Solves mean(rho(x / s)) = 1/2 with Tukey's bounded rho (Rousseeuw & Yohai 1984): unlike the median, it hears a
    minority of surfaces that are off.
    """
    scale = group_quantile(values.abs(), owner, groups, HALF) / NORMAL_MEDIAN
    counts = torch.bincount(owner, minlength=groups)
    for _ in range(30):
        ratio = values / (BIWEIGHT * scale.clamp_min(torch.finfo(scale.dtype).tiny))[owner]
        loss = 1 - (1 - ratio.square().clamp_max(1)) ** 3
        scale = scale * torch.sqrt(group_sum(loss, owner, groups) / (counts * HALF))
    return scale


def distance_scale(matcher: Matcher, matches: Matches, groups: int) -> torch.Tensor:
    """Robust standard deviation of the Mahalanobis distances of what is within reach, (P,); infinite for nothing."""
    near = matcher.within_reach(matches, matches.across.new_zeros(groups))
    median = group_quantile(matches.squared.sqrt()[near], matches.owner[near], groups, 0.5)
    # Two scans that are one and the same are all zeros, by which nothing can be divided.
    return (median / NORMAL_MEDIAN).nan_to_num(torch.inf).clamp_min(torch.finfo(median.dtype).eps)


def widest(matcher: Matcher, matches: Matches, groups: int) -> torch.Tensor:
    """A width c that lets every match within reach be heard, (P,)."""
    reach = REACH * (matcher.current.extents[matches.current] + matcher.reference.extents[matches.reference])
    distances = reach * matches.trace.sqrt()
    return group_quantile(distances, matches.owner, groups, 0.5).nan_to_num(0)


def loss(squared: torch.Tensor, width: torch.Tensor) -> torch.Tensor:
    """Geman & McClure's rho_c(d) = c^2 d^2 / (c^2 + d^2) for squared distances (M,) and c (M,)."""
    limit = width.square()
    return limit * squared / (limit + squared)


def trust(squared: torch.Tensor, width: torch.Tensor) -> torch.Tensor:
    """Weight of a match, rho_c'(d) / 2 d, (M,); 1 for an infinite c."""
    return (1 + squared / width.square()) ** -2
