r"""Distribution-to-distribution alignment of two clouds of Gaussians, robust to what has changed.

Every cell is a Gaussian of surface (`surfels`). With r_i = R x_i + t - y_j the difference to the nearest Gaussian of
the reference, minimised is

    sum_i n_i rho_c(d_i),   d_i^2 = r_i^T (R A_i R^T + B_j)^-1 r_i,   rho_c(d) = c^2 d^2 / (c^2 + d^2)

by Gauss-Newton on SE(3) with iterative reweighting (the Mahalanobis distance is that of D2D-NDT, Stoyanov et al.
2012; rho is Geman & McClure's). c starts wide and shrinks to three robust standard deviations of what is matched:
graduated non-convexity, so an object that moved is heard at first and has no say at the end. Directions that the
scans do not fix are left alone (Zhang, Kaess & Singh 2016).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from novelty.registration.matching import Matcher, Matches
from novelty.registration.motion import Levers, Motions, cross_matrices
from novelty.registration.robust import WIDTH, distance_scale, group_quantile, group_sum, trust, widest

OBSERVABLE = 0.003
"""Share of the matched surface that must face a direction for the pose to be fixed in it."""

LEVELS = (400, 1600)
"""Surfels per scan of the coarse levels that find the pose before all cells polish it."""

SHRINK = 0.6
"""By how much c narrows once the motion has settled at a width, until it meets the scale of the residuals."""

CALM = 0.05
"""A step below this share of a typical surfel's extent has settled enough to narrow c."""

TOLERANCE = 0.01
"""A step below this share of a typical cell's extent is none."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """Motions (P) of the current surfels onto the reference's, how many steps they took, and whether these died out."""

    motions: Motions
    num_iterations: torch.Tensor
    converged: torch.Tensor


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Gauss-Newton system of P pairs in displacements (`Levers`): H s = -g.

    Attributes:
        hessian: (P, 6, 6).
        gradient: (P, 6).
        facing: (P, 6, 6), the same as `hessian` with every match counted alike that tells as much as the median one:
            eigenvalues are shares of surface. Two patches that cross fix nothing, so they hardly count.
    """

    hessian: torch.Tensor
    gradient: torch.Tensor
    facing: torch.Tensor

    def num_observable(self) -> torch.Tensor:
        """How many directions the scans fix, int64 (P,)."""
        return (torch.linalg.eigvalsh(self.facing) > OBSERVABLE).sum(-1)

    def observable(self) -> torch.Tensor:
        """Projections onto the directions that the scans fix, (P, 6, 6)."""
        values, vectors = torch.linalg.eigh(self.facing)
        kept = vectors * (values > OBSERVABLE)[:, None, :]
        return kept @ vectors.transpose(1, 2)

    def within(self, allowed: torch.Tensor) -> NormalEquations:
        """The same system with only the directions of the projections `allowed` (P, 6, 6) to go."""
        return replace(self, facing=allowed @ self.facing @ allowed)

    def step(self) -> torch.Tensor:
        """Gauss-Newton step inside the observable directions, (P, 6)."""
        inside = self.observable()
        scale = self.hessian.diagonal(dim1=1, dim2=2).sum(-1).clamp_min(torch.finfo(inside.dtype).tiny)
        outside = torch.eye(6, dtype=inside.dtype) - inside
        system = inside @ self.hessian @ inside + scale[:, None, None] * outside
        return -torch.linalg.solve_ex(system, inside @ self.gradient[:, :, None])[0][:, :, 0]


@dataclass(frozen=True, eq=False)
class _State:
    """Where the descent of P pairs stands: motions, steps taken (P,), whether they died out (P,)."""

    motions: Motions
    num_iterations: torch.Tensor
    converged: torch.Tensor


def align(matcher: Matcher, max_iterations: int) -> Alignment:
    """Align the current surfels of P pairs with the reference's, starting from the given poses."""
    pairs = len(matcher.current.sizes)
    state = _State(
        Motions.identity(pairs),
        torch.zeros(pairs, dtype=torch.long),
        torch.zeros(pairs, dtype=torch.bool),
    )
    for level in LEVELS:
        coarse = matcher.merged(level)
        first = widest(coarse, coarse.match(state.motions), pairs) if level == LEVELS[0] else None
        state = _descend(coarse, state, first, max_iterations)
    state = _descend(matcher, state, None, max_iterations)
    state = _without_slides(matcher, state, max_iterations)
    return Alignment(state.motions, state.num_iterations, state.converged)


def _without_slides(matcher: Matcher, state: _State, max_iterations: int) -> _State:
    """The poses without slides; the pairs that slid settle again in the directions that are fixed."""
    slides = slides_of(matcher, state.motions)
    if not slides.slid.any():
        return state
    again = _descend(matcher, replace(state, motions=slides.taken_back), None, max_iterations, slides.allowed)
    return _State(
        motions=again.motions.where(slides.slid, state.motions),
        num_iterations=torch.where(slides.slid, again.num_iterations, state.num_iterations),
        converged=torch.where(slides.slid, again.converged, state.converged),
    )


@dataclass(frozen=True, eq=False)
class Slides:
    """What motions of P pairs moved in directions that, where they ended, the scans do not fix.

    A wide kernel hears surfaces that have no say at the end: a few of them can slide a corridor along its axis.

    Attributes:
        slid: (P,) bool.
        taken_back: The motions without it; those that did not slide as they were.
        allowed: Projections (P, 6, 6) onto the directions that the scans fix.
    """

    slid: torch.Tensor
    taken_back: Motions
    allowed: torch.Tensor


def slides_of(matcher: Matcher, motions: Motions) -> Slides:
    """How far motions slid."""
    levers, extent = levers_of(matcher), _typical_extent(matcher)
    matches = matcher.match(motions)
    width = WIDTH * distance_scale(matcher, matches, len(extent)).nan_to_num(posinf=0).clamp_min(1e-12)
    allowed = normal_equations(matcher, matches, width, levers).observable()
    travelled = levers.displacements(motions.steps())
    kept = (allowed @ travelled[:, :, None])[:, :, 0]
    slid = (travelled - kept).norm(dim=-1) > CALM * extent
    back = Motions.identity(len(extent)).then(levers.steps(kept))
    return Slides(slid, back.where(slid, motions), allowed)


def _descend(
    matcher: Matcher,
    state: _State,
    width: torch.Tensor | None,
    max_iterations: int,
    allowed: torch.Tensor | None = None,
) -> _State:
    """Gauss-Newton steps until they die out for every pair; a pair that has arrived stays where it is.

    Args:
        matcher: The surfels of one level.
        state: Where to start.
        width: c at the start (P,); None: as wide as the residuals ask for.
        max_iterations: Most steps.
        allowed: Projections (P, 6, 6) onto the directions to move in; None: all that the scans fix.
    """
    pairs = len(state.converged)
    levers, extent = levers_of(matcher), _typical_extent(matcher)
    motions, iterations = state.motions, state.num_iterations.clone()
    active, length = torch.ones(pairs, dtype=torch.bool), extent.new_full((pairs,), torch.inf)
    for _ in range(max_iterations):
        matches = matcher.match(motions)
        # Nothing within reach: nothing is heard, and nothing moves.
        target = WIDTH * distance_scale(matcher, matches, pairs).nan_to_num(posinf=0).clamp_min(1e-12)
        width = target if width is None else torch.maximum(width, target)
        equations = normal_equations(matcher, matches, width, levers)
        steps = (equations if allowed is None else equations.within(allowed)).step()
        motions = motions.then(levers.steps(steps)).where(active, motions)
        iterations += active
        length = steps.norm(dim=-1)
        active &= ~((width <= target) & (length <= TOLERANCE * extent))
        if not active.any():
            break
        # Narrow once the motion has settled at this width: a minority of surfaces may still be on its way.
        width = torch.where(length <= CALM * extent, SHRINK * width, width)
    # Nearest neighbours that flip between two answers keep the last steps small, not nil.
    return _State(motions, iterations, ~active | (length <= CALM * extent))


def levers_of(matcher: Matcher) -> Levers:
    """The levers on which turns move the current surfels."""
    return Levers.of(matcher.current.means, matcher.current.owner, len(matcher.current.sizes))


def _typical_extent(matcher: Matcher) -> torch.Tensor:
    """Extent of a typical reference cell, (P,), m."""
    pairs = len(matcher.reference.sizes)
    return group_quantile(matcher.reference.extents, matcher.reference.owner, pairs, 0.5).nan_to_num(0)


def normal_equations(
    matcher: Matcher, matches: Matches, width: torch.Tensor, levers: Levers
) -> NormalEquations:
    """The Gauss-Newton system at these matches for c = `width` (P,), dimensionless."""
    pairs, owner = len(width), matches.owner
    typical = width[owner] * matches.trace.rsqrt()
    near = matcher.within_reach(matches, group_quantile(typical, owner, pairs, 0.5).nan_to_num(0))
    weight = near * matcher.support(matches) * trust(matches.squared, width[owner])  # (M,)
    jacobian = torch.cat(
        [
            -cross_matrices(matches.positions) @ levers.inverses[owner],
            torch.eye(3, dtype=width.dtype).expand(len(owner), 3, 3),
        ],
        dim=-1,
    )  # (M, 3, 6)
    weighted = matches.information @ jacobian * weight[:, None, None]
    curvature = jacobian.transpose(1, 2) @ weighted  # (M, 6, 6)
    gradient = (weighted.transpose(1, 2) @ matches.differences[:, :, None])[:, :, 0]
    median = group_quantile(matches.trace, owner, pairs, 0.5).nan_to_num(0)
    counts_alike = torch.maximum(matches.trace, median[owner])
    counted = group_sum(weight, owner, pairs).clamp_min(torch.finfo(width.dtype).tiny)
    return NormalEquations(
        hessian=group_sum(curvature, owner, pairs),
        gradient=group_sum(gradient, owner, pairs),
        facing=group_sum(curvature / counts_alike[:, None, None], owner, pairs) / counted[:, None, None],
    )
