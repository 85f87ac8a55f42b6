"""Generalized ICP (Segal, Haehnel & Thrun 2009) by Open3D, on the Gaussians of the cells, with a robust kernel."""

from __future__ import annotations

from typing import Any

import torch

from novelty.io.open3d_library import load_open3d
from novelty.registration.matching import Matcher
from novelty.registration.mixture import TOLERANCE, Alignment, slides_of
from novelty.registration.motion import Motions
from novelty.registration.robust import WIDTH, distance_scale, group_quantile
from novelty.registration.surfels import Surfels

SCALES = (8.0, 8.0, 4.0, 4.0, 4.0)
"""Search radius of each round, in typical extents of a reference cell; the kernel narrows from round to round."""

SETTLED = 10 * TOLERANCE
"""Motion of the last round, in typical extents, below which the rounds have converged."""


def align_gicp(matcher: Matcher, max_iterations: int) -> Alignment:
    """Align the current surfels of P pairs with the reference's; inside a round, one pair after the other.

    Open3D does not say how many steps it took: `num_iterations` is the most it may have taken. It does not know which
    directions the scans leave open either: what it moved in those is taken back.

    Raises:
        MissingDependencyError: Open3D cannot be loaded.
    """
    pairs = len(matcher.current.sizes)
    current, reference = _clouds(matcher.current), _clouds(matcher.reference)
    extents = group_quantile(matcher.reference.extents, matcher.reference.owner, pairs, 0.5).nan_to_num(0)
    motions = Motions.identity(pairs)
    moved = torch.zeros(pairs, dtype=torch.float64)
    for scale in SCALES:
        width = WIDTH * distance_scale(matcher, matcher.match(motions), pairs)
        reaches = (scale * extents).tolist()
        found = [
            _refine(*pair, max_iterations)
            for pair in zip(current, reference, motions.matrices(), reaches, width.tolist(), strict=True)
        ]
        before, motions = motions, Motions.from_matrices(torch.stack(found))
        moved = _largest_motion(matcher.current, before, motions)
    return Alignment(
        slides_of(matcher, motions).taken_back,
        num_iterations=torch.full((pairs,), max_iterations * len(SCALES)),
        converged=moved <= SETTLED * extents,
    )


def _clouds(surfels: Surfels) -> list[Any]:
    """Open3D clouds with covariances, one per pair."""
    open3d = load_open3d()
    clouds = []
    for means, shapes in zip(
        surfels.means.split(surfels.sizes), surfels.shapes.split(surfels.sizes), strict=True
    ):
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(means.numpy()))
        cloud.covariances = open3d.utility.Matrix3dVector(shapes.numpy())
        clouds.append(cloud)
    return clouds


def _refine(
    current: Any, reference: Any, start: torch.Tensor, reach: float, width: float, max_iterations: int
) -> torch.Tensor:
    """One run of generalized ICP, (4, 4); `start` where there is nothing to match."""
    if not len(current.points) or not len(reference.points):
        return start
    registration = load_open3d().pipelines.registration
    kernel = registration.GMLoss(width**2)
    estimation = registration.TransformationEstimationForGeneralizedICP(kernel)
    criteria = registration.ICPConvergenceCriteria(max_iteration=max_iterations)
    found = registration.registration_generalized_icp(
        current, reference, reach, start.numpy(), estimation, criteria
    )
    refined = torch.tensor(found.transformation, dtype=torch.float64)
    # With too few matches Open3D's solver fails and answers NaN: stay, to be judged from where it stopped.
    return refined if refined.isfinite().all() else start


def _largest_motion(surfels: Surfels, before: Motions, after: Motions) -> torch.Tensor:
    """Greatest displacement of a surfel between two motions, (P,), m."""
    paths = after.apply(surfels.means, surfels.owner) - before.apply(surfels.means, surfels.owner)
    return group_quantile(paths.norm(dim=-1), surfels.owner, len(surfels.sizes), 1.0).nan_to_num(0)
