"""How well two scans fit under their motions: what is left, how much overlaps, which directions are fixed."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from novelty.registration.matching import Matcher, Matches
from novelty.registration.mixture import levers_of, normal_equations
from novelty.registration.robust import WIDTH, distance_scale, group_quantile, group_sum, loss, scale_of


@dataclass(frozen=True, eq=False)
class Quality:
    """Fit of P pairs.

    Attributes:
        residual: (P,), m, see `Registrations.residual`.
        overlap: (P,), share of the current surfels with a counterpart.
        observable: int64 (P,), number of degrees of freedom that the matches fix.
        scale: (P,), robust standard deviation of the Mahalanobis distances.
    """

    residual: torch.Tensor
    overlap: torch.Tensor
    observable: torch.Tensor
    scale: torch.Tensor

    def where(self, condition: torch.Tensor, other: Quality) -> Quality:
        """These where `condition` (P,), the other's elsewhere."""
        return Quality(
            residual=torch.where(condition, self.residual, other.residual),
            overlap=torch.where(condition, self.overlap, other.overlap),
            observable=torch.where(condition, self.observable, other.observable),
            scale=torch.where(condition, self.scale, other.scale),
        )


def measure(matcher: Matcher, matches: Matches) -> Quality:
    """Judge the fit of P pairs by their matches under some motions."""
    pairs = len(matcher.current.sizes)
    near = matcher.within_reach(matches, matches.across.new_zeros(pairs))
    close = matches.select(torch.nonzero(near)[:, 0])
    spread = scale_of(close.across, close.owner, pairs)
    noise = group_quantile(matcher.noise(close), close.owner, pairs, 0.5)
    scale = distance_scale(matcher, matches, pairs)
    equations = normal_equations(matcher, matches, WIDTH * scale, levers_of(matcher))
    return Quality(
        residual=(spread.square() - noise).clamp_min(0).sqrt(),
        overlap=_overlap(matcher, close, spread),
        observable=equations.num_observable(),
        scale=scale,
    )


def cost(matcher: Matcher, matches: Matches, scale: torch.Tensor) -> torch.Tensor:
    """Robust sum of squares in units of its variance, (P,), at a common `scale` (P,) of Mahalanobis distances.

    If the given pose is right, a refined one lowers it by about a chi-square of as many degrees as the pose has.
    """
    pairs = len(scale)
    normalised = matches.squared / scale[matches.owner].square()
    near = matcher.within_reach(matches, matches.across.new_zeros(pairs))
    # Out of reach costs what an infinite distance would.
    losses = torch.where(near, loss(normalised, torch.full_like(normalised, WIDTH)), WIDTH**2)
    return group_sum(losses, matches.owner, pairs)


def _overlap(matcher: Matcher, close: Matches, spread: torch.Tensor) -> torch.Tensor:
    own = matcher.current.thickness[close.current]
    other = matcher.reference.thickness[close.reference]
    variance = own.square() + other.square() + spread[close.owner].square()
    matched = (close.across.square() <= WIDTH**2 * variance).to(spread.dtype)
    sizes = torch.tensor(matcher.current.sizes).clamp_min(1)
    return group_sum(matched, close.owner, len(sizes)) / sizes
