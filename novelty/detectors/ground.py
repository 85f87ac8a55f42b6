"""The ground distance between components that earth mover's distances are made of."""

from __future__ import annotations

from typing import Literal

from torch import Tensor

import gmmtorch.distances
from gmmtorch import GaussianMixtures

GroundDistanceName = Literal["hellinger", "mean", "bures", "combined"]
"""Pure numbers, except `mean` and `bures`, which are in metres."""

UNITS: dict[GroundDistanceName, str] = {"hellinger": "", "mean": " m", "bures": " m", "combined": ""}
"""What to print behind a distance."""


def ground_distances(
    name: GroundDistanceName, a: GaussianMixtures, b: GaussianMixtures, length_scale: float
) -> Tensor:
    """Distance between every component of the mixtures a and every one of b (P, K_a, K_b)."""
    return gmmtorch.distances.ground_distance(
        name, a.means, a.covariances, b.means, b.covariances, length_scale=length_scale
    )
