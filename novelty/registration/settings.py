"""The settings of registration; there is no length among them: every scale comes from the scans."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from novelty.section import section


@section
class Registration:
    """How the given poses are refined before the comparison (the paper's future work)."""

    method: Literal["none", "gicp", "mixture"] = Field(
        default="mixture",
        description="none: the poses are kept and only the misalignment is measured; gicp: Open3D's generalized "
        "ICP with a robust kernel; mixture: Gaussians of both scans aligned to each other, robust to changes.",
    )
    max_iterations: int = Field(default=40, ge=1, description="Steps of a round of the optimisation.")
    min_overlap: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="Least share of the current scan's cells with a counterpart; below it the given pose is kept.",
    )
