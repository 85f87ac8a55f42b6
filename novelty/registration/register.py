"""Registration of a batch of prepared pairs: align, judge, and keep the given pose where the answer is doubtful."""

from __future__ import annotations

import torch

from gmmtorch import PointClouds
from novelty.preprocess.prepared import PreparedPairs, PreparedScans
from novelty.preprocess.simplify import Scale, simplify
from novelty.registration.gicp import align_gicp
from novelty.registration.matching import Matcher
from novelty.registration.mixture import Alignment, align
from novelty.registration.motion import Motions
from novelty.registration.quality import Quality, cost, measure
from novelty.registration.result import Registrations, RegistrationStatus
from novelty.registration.robust import group_sum
from novelty.registration.settings import Registration
from novelty.registration.surfels import centres_of, surfels_of

MIN_SURFELS = 30
"""Fewer flat cells do not make a pose."""

SIGNIFICANT = 30.0
"""Least fall of the robust sum of squares that tells a better pose from chance (chi-square, 6 degrees: p = 4e-5)."""

FARTHEST = 0.5
"""How far a refinement moves the surfels, root mean square, as a share of their distance from their middle."""

DEGREES_OF_FREEDOM = 6


def register(batch: PreparedPairs, settings: Registration) -> Registrations:
    """Refine the pose of the current scan of every pair, starting from the given one.

    The batch is not changed. Ground and everything else that preprocessing took out has no say, so a floor can only
    help where the batch was prepared with it. Works on the CPU, where the search trees are.

    Args:
        batch: P pairs, lengths in metres.
        settings: How to register.

    Raises:
        MissingDependencyError: The method is `gicp` and Open3D cannot be loaded.
    """
    current, reference = _cells(batch.current), _cells(batch.reference)
    # Around the middle of the reference: maps may lie at 5e5 m, where a turn about the origin is a long way.
    centres = centres_of(reference.points, reference.sizes)
    matcher = Matcher(surfels_of(current, centres), surfels_of(reference, centres))
    given = Motions.identity(len(batch))
    before = matcher.match(given)
    if settings.method == "none":
        return _kept(given, measure(matcher, before))
    aligned = (align if settings.method == "mixture" else align_gicp)(matcher, settings.max_iterations)
    after = matcher.match(aligned.motions)
    unrefined, refined = measure(matcher, before), measure(matcher, after)
    gain = cost(matcher, before, refined.scale) - cost(matcher, after, refined.scale)
    # A better pose brings surfaces closer; one that finds more of them no closer has slid to others.
    better = (gain >= SIGNIFICANT) & (refined.scale < unrefined.scale)
    status = _judge(matcher, aligned, refined, better, settings.min_overlap)
    accepted = torch.tensor([not RegistrationStatus(code).kept_given_pose for code in status.tolist()])
    motions = aligned.motions.where(accepted, given)
    # What a detector is told is true of the pose that is used.
    final = refined.where(accepted, unrefined)
    return Registrations(
        transforms=motions.about(centres).matrices(),
        residual=final.residual,
        shift=_shift(matcher, motions),
        turn=motions.angles(),
        overlap=final.overlap,
        observable=final.observable,
        num_iterations=aligned.num_iterations,
        converged=aligned.converged,
        status=status,
    )


def _cells(scans: PreparedScans) -> PointClouds:
    """The cells of the scans, or where every point is its own cell, cells made for this purpose."""
    cells = scans.cells.to(device="cpu")
    if cells.spreads is not None:
        return cells
    return simplify(scans.points.to(device="cpu"), Scale()).cells


def _judge(
    matcher: Matcher, aligned: Alignment, refined: Quality, better: torch.Tensor, min_overlap: float
) -> torch.Tensor:
    """Status of every pair, int64 (P,); where several hold, the last of the list."""
    sizes = torch.minimum(torch.tensor(matcher.current.sizes), torch.tensor(matcher.reference.sizes))
    status = torch.full_like(sizes, RegistrationStatus.OK)
    for condition, code in (
        (refined.observable < DEGREES_OF_FREEDOM, RegistrationStatus.UNOBSERVABLE),
        (_path(matcher, aligned.motions) > FARTHEST * _size(matcher), RegistrationStatus.FAR_AWAY),
        (~better, RegistrationStatus.NO_BETTER),
        (~aligned.converged, RegistrationStatus.NOT_CONVERGED),
        (~(refined.overlap >= min_overlap), RegistrationStatus.LOW_OVERLAP),
        (sizes < MIN_SURFELS, RegistrationStatus.TOO_FEW_CELLS),
    ):
        status = torch.where(condition, int(code), status)
    return status


def _kept(given: Motions, quality: Quality) -> Registrations:
    """The result of `none`: nothing moved, the misalignment measured."""
    pairs = len(quality.residual)
    zeros = torch.zeros(pairs, dtype=torch.float64)
    return Registrations(
        transforms=given.matrices(),
        residual=quality.residual,
        shift=zeros,
        turn=zeros,
        overlap=quality.overlap,
        observable=quality.observable,
        num_iterations=torch.zeros(pairs, dtype=torch.long),
        converged=torch.ones(pairs, dtype=torch.bool),
        status=torch.full((pairs,), int(RegistrationStatus.NOT_ASKED)),
    )


def _shift(matcher: Matcher, motions: Motions) -> torch.Tensor:
    """How far the mean of the current surfels was moved, (P,), m."""
    means = centres_of(matcher.current.means, matcher.current.sizes)
    return (motions.apply(means, torch.arange(len(means))) - means).norm(dim=-1)


def _path(matcher: Matcher, motions: Motions) -> torch.Tensor:
    """How far the current surfels were moved, root mean square, (P,), m."""
    means, owner = matcher.current.means, matcher.current.owner
    return _root_mean_square(motions.apply(means, owner) - means, matcher)


def _size(matcher: Matcher) -> torch.Tensor:
    """Root-mean-square distance of the current surfels from their mean, (P,), m."""
    means = matcher.current.means
    return _root_mean_square(means - centres_of(means, matcher.current.sizes)[matcher.current.owner], matcher)


def _root_mean_square(vectors: torch.Tensor, matcher: Matcher) -> torch.Tensor:
    sizes = torch.tensor(matcher.current.sizes).clamp_min(1)
    return (group_sum(vectors.square().sum(-1), matcher.current.owner, len(sizes)) / sizes).sqrt()
