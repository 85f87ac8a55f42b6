"""The settings of preprocessing; lengths are in metres whatever the unit of the scans."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from novelty.section import section


@section
class Preprocess:
    """What is taken out of a scan and how the rest is simplified (section 2.2)."""

    min_range: float | None = Field(
        default=None,
        ge=0,
        description="Least distance from the sensor, m; null: no limit. Needs the scan's origin.",
    )
    max_range: float | None = Field(
        default=None,
        gt=0,
        description="Greatest distance from the sensor, m; null: no limit. Needs the scan's origin.",
    )
    min_height: float | None = Field(
        default=None, description="Least coordinate along `up`, in the frame of the scan, m; null: no limit."
    )
    max_height: float | None = Field(
        default=None,
        description="Greatest coordinate along `up`, in the frame of the scan, m; null: no limit.",
    )
    outliers: Literal["local", "statistical", "none"] = Field(
        default="local",
        description="How sparse outliers are taken out. local: points farther from their neighbours than these are "
        "from theirs; statistical: farther than is usual in the scan (Rusu et al. 2008), which costs far surfaces.",
    )
    outlier_neighbors: int = Field(
        default=20, ge=2, description="Neighbours whose mean distance is looked at."
    )
    outlier_std_ratio: float = Field(
        default=2.0,
        gt=0,
        description="statistical: a point is an outlier beyond mean + ratio * standard deviation of that distance.",
    )
    outlier_ratio: float = Field(
        default=2.0,
        ge=1,
        description="local: a point is an outlier when that distance is this many times the median of its neighbours'.",
    )
    ground: Literal["ransac", "none"] = Field(
        default="ransac", description="How the ground plane is taken out (Lai & Fox 2009)."
    )
    up: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 1.0),
        description="Direction away from the ground in the frame of the scan; any length.",
    )
    max_ground_tilt: float = Field(
        default=15.0, ge=0, le=90, description="Greatest angle between the ground's normal and `up`, degrees."
    )
    ground_distance: float | None = Field(
        default=None,
        gt=0,
        description="Points this near to the plane belong to the ground, m; null: from the scan's own spacing "
        "and noise.",
    )
    feet: bool = Field(
        default=True,
        description="Whether points that near stay where they stand higher than the ground that the other scan of the "
        "pair measured around them: the feet of what has appeared.",
    )
    simplify: Literal["or", "and", "none"] = Field(
        default="or",
        description="A cluster is split while it has more than `max_cell_size` points or (and) its surface "
        "variation is above `max_surface_variation`; none: every point is a cell.",
    )
    max_cell_size: int = Field(default=20, ge=1, description="Points in a cluster that need not be split.")
    max_surface_variation: float = Field(
        default=0.1,
        ge=0,
        le=1 / 3,
        description="Surface variation (eq. 1) of a cluster that need not be split.",
    )
    seed: int = Field(default=0, ge=0, description="Seed of RANSAC; every scan starts from it anew.")
