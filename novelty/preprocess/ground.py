"""The ground plane, found by RANSAC and taken out (section 2.2; Fischler & Bolles 1981, Lai & Fox 2009).

The largest plane of a scan is often a wall, a ceiling or a table top. A plane counts as the ground only if it is
nearly level, hardly anything lies below it, it holds a fair share of the points and stands out from what is just
above it. The search is our own because of these conditions, and because a seed then fixes the answer: Open3D's
`segment_plane` returns different planes for one seed when it runs on several threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.preprocess.settings import Preprocess
from novelty.preprocess.spacing import Spacing
from novelty.preprocess.survivors import Survivors
from novelty.preprocess.vertical import up_vector

STEP = "ground"

NUM_TRIPLES = 40_000
"""Planes through three random points; nearly all are too steep to be looked at again."""
NUM_HYPOTHESES = 1_000
NUM_SAMPLES = 2_000
"""Points on which the hypotheses are scored."""
NUM_REFINEMENTS = 5
MIN_SHARE = 0.05
"""Share of the points that a ground holds at least."""
MAX_BELOW = 0.03
"""Share of the points that may lie below it: reflections, a stair going down."""
MIN_CONTRAST = 3.0
"""A ground holds this many times the points of the equally thick layer above it; walls alone give 1."""
MIN_EXTENT = 0.25
"""Its root-mean-square extent as a share of the scan's, seen from above: an object's side facing a camera has less."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Points p with normal . p = height; `tolerance` is how far from it its points lie, m."""

    normal: NDArray[np.float64]
    height: float
    tolerance: float

    def heights(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distances of points (N, 3) from the plane, m, positive above."""
        return points @ self.normal - self.height

    def holds(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether points (N, 3) belong to the plane."""
        return np.abs(self.heights(points)) <= self.tolerance


@dataclass(frozen=True)
class NoGround:
    """Why no plane of a scan is its ground; empty when none was looked for."""

    reason: str


def drop_ground(
    scan: Survivors, ground: Plane | NoGround, feet: NDArray[np.bool_] | None = None
) -> Survivors:
    """Take out the ground's points, but for feet (N,); without a ground, take nothing and say so."""
    if isinstance(ground, NoGround):
        return scan.noted(f"No ground was taken out: {ground.reason}.") if ground.reason else scan
    stays = ~ground.holds(scan.points)
    return scan.only(stays if feet is None else stays | feet, STEP)


def agree_on_ground(
    grounds: tuple[Plane | NoGround, Plane | NoGround], scans: tuple[Survivors, Survivors]
) -> tuple[Plane | NoGround, Plane | NoGround]:
    """Grounds of two scans of one place: what one lost and the other kept would look novel.

    Where only one has a ground, its plane serves both if it holds a fair share of the other scan too; otherwise
    neither loses anything.

    Args:
        grounds: The ground found in each scan.
        scans: The two scans, in one frame.
    """
    for row in (0, 1):
        plane, other = grounds[row], scans[1 - row]
        if isinstance(plane, Plane) and isinstance(grounds[1 - row], NoGround):
            if len(other) and plane.holds(other.points).mean() >= MIN_SHARE:
                return plane, plane
            nowhere = NoGround("only one of the two scans shows it")
            return nowhere, nowhere
    return grounds


def follow_ground(known: Plane | NoGround, found: Plane | NoGround) -> Plane | NoGround:
    """Ground of a scan that is compared with an earlier one, of which nothing can be taken out any more.

    Args:
        known: What was taken out of the earlier scan.
        found: The ground of the new scan, in the same frame.
    """
    if isinstance(known, Plane):
        return found if isinstance(found, Plane) else known
    return NoGround("the earlier scan kept its own") if isinstance(found, Plane) else found


def find_ground(scan: Survivors, settings: Preprocess, spacing: Spacing) -> Plane | NoGround:
    """The ground plane of one scan; the same for the same scan and seed."""
    if settings.ground == "none" or len(scan) == 0:
        return NoGround("")
    up = up_vector(settings)
    tolerance = _tolerance(settings, spacing)
    centre = scan.points.mean(axis=0)
    points = scan.points - centre
    if not tolerance > 0:
        return NoGround("its points do not span a plane")
    # RANSAC: planes through three points, scored on a sample.
    rng = np.random.default_rng(settings.seed)
    best = _best_hypothesis(points, up, settings.max_ground_tilt, tolerance, rng)
    if best is None:
        return NoGround(
            f"no plane through its points is within {settings.max_ground_tilt:g} degrees of level"
        )
    # Least squares over the inliers; the tolerance follows their scatter unless it is given.
    plane = _refined(best, points, up, fixed=settings.ground_distance is not None)
    reason = _objection(plane, points, up, settings) or _above_sensor(plane, scan, centre)
    if reason:
        return NoGround(reason)
    return Plane(plane.normal, plane.height + float(plane.normal @ centre), plane.tolerance)


def _tolerance(settings: Preprocess, spacing: Spacing) -> float:
    if settings.ground_distance is not None:
        return settings.ground_distance
    return max(2 * spacing.distance, 3 * spacing.noise)


def _best_hypothesis(
    points: NDArray[np.float64],
    up: NDArray[np.float64],
    max_tilt: float,
    tolerance: float,
    rng: np.random.Generator,
) -> Plane | None:
    """The nearly level plane that holds most of a sample, less ten times what lies below it."""
    normals, heights = _level_planes(points, up, max_tilt, rng)
    if len(normals) == 0:
        return None
    sample = points[rng.integers(0, len(points), min(NUM_SAMPLES, len(points)))]
    distances = sample @ normals.T - heights  # (T, H)
    holds = np.count_nonzero(np.abs(distances) <= tolerance, axis=0)
    below = np.count_nonzero(distances < -tolerance, axis=0)
    best = int(np.argmax(holds - 10 * below))
    return Plane(normals[best], float(heights[best]), tolerance)


def _level_planes(
    points: NDArray[np.float64], up: NDArray[np.float64], max_tilt: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Planes through three random points within `max_tilt` of level: upward normals (H, 3), heights (H,)."""
    corners = points[rng.integers(0, len(points), (3, NUM_TRIPLES))]
    normals = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    lengths = np.linalg.norm(normals, axis=1)
    cosines = normals @ up
    level = np.flatnonzero((np.abs(cosines) >= np.cos(np.radians(max_tilt)) * lengths) & (lengths > 0))
    level = level[:NUM_HYPOTHESES]
    normals = normals[level] / (np.where(cosines < 0, -1, 1) * lengths)[level, None]
    return normals, np.einsum("hd,hd->h", normals, corners[0, level])


def _refined(plane: Plane, points: NDArray[np.float64], up: NDArray[np.float64], fixed: bool) -> Plane:
    """Least-squares plane through the inliers, again and again."""
    widest = plane.tolerance if fixed else 2 * plane.tolerance
    for _ in range(NUM_REFINEMENTS):
        inliers = points[plane.holds(points)]
        if len(inliers) < 3:
            break
        mean = inliers.mean(axis=0)
        normal = np.linalg.eigh((inliers - mean).T @ (inliers - mean))[1][:, 0]
        normal = normal if normal @ up > 0 else -normal
        tolerance = plane.tolerance if fixed else _scatter(points @ normal - normal @ mean, widest)
        plane = Plane(normal, float(normal @ mean), tolerance)
    return plane


def _scatter(heights: NDArray[np.float64], widest: float) -> float:
    """Three robust standard deviations of the heights within `widest`, at least half of it, at most all."""
    near = np.abs(heights[np.abs(heights) <= widest])
    return float(np.clip(3 * 1.4826 * np.median(near), widest / 2, widest)) if len(near) else widest / 2


def _objection(
    plane: Plane, points: NDArray[np.float64], up: NDArray[np.float64], settings: Preprocess
) -> str | None:
    """Why a plane is not the ground of these points; None if it is."""
    tilt = float(np.degrees(np.arccos(np.clip(plane.normal @ up, -1, 1))))
    if tilt > settings.max_ground_tilt:
        return f"the lowest plane is {tilt:.0f} degrees from level (max_ground_tilt={settings.max_ground_tilt:g})"
    heights = plane.heights(points)
    below = float(np.mean(heights < -plane.tolerance))
    if below > MAX_BELOW:
        return f"{below:.0%} of its points lie below its best level plane"
    holds = np.abs(heights) <= plane.tolerance
    if holds.mean() < MIN_SHARE:
        return f"its lowest level plane holds {holds.mean():.1%} of its points (at least {MIN_SHARE:.0%} expected)"
    above = np.count_nonzero((heights > plane.tolerance) & (heights <= 3 * plane.tolerance))
    if np.count_nonzero(holds) < MIN_CONTRAST * above:
        return "no level plane stands out at its low end"
    extent = _extent(points[holds], up) / _extent(points, up)
    if extent < MIN_EXTENT:
        return f"its lowest level plane has only {extent:.0%} of the scan's extent seen from above"
    return None


def _extent(points: NDArray[np.float64], up: NDArray[np.float64]) -> float:
    """Root-mean-square distance of points from the vertical line through their mean, m."""
    offsets = points - points.mean(axis=0)
    along = offsets @ up
    return float(np.sqrt(max(np.mean(np.einsum("nd,nd->n", offsets, offsets) - along * along), 0)))


def _above_sensor(plane: Plane, scan: Survivors, centre: NDArray[np.float64]) -> str | None:
    """Why the sensor's place speaks against a plane; None if it does not or is unknown."""
    origins = scan.point_origins
    if origins is None:
        return None
    if np.median(plane.heights(np.atleast_2d(origins) - centre)) < plane.tolerance:
        return "its lowest level plane is above the sensor; check the direction `up`"
    return None
