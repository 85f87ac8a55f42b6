"""What is tried for each detector: settings that act after the fit, so that one fit serves all of them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

GRIDS: dict[str, dict[str, tuple[Any, ...]]] = {
    "greedy_emd": {
        "ground_distance": ("hellinger", "mean", "bures", "combined"),
        "tolerance": (1e-9, 1e-3, 1e-2),
    },
    "unbalanced_emd": {"reach": (0.5, 0.6, 0.7, 0.85, 1.0), "share": (0.3, 0.4, 0.5, 0.6, 0.7)},
    "joint_mixture": {"share": (0.05, 0.1, 0.15, 0.2, 0.3, 0.4), "significance": (0.01, 0.05, 0.2)},
    "likelihood": {
        "false_discovery_rate": (0.01, 0.05, 0.2),
        "explained_share": (0.03, 0.1, 0.3),
        "quorum": (0.3, 0.5, 0.7),
    },
    "nearest_neighbour": {"distance": (0.01, 0.02, 0.04, 0.1, 0.2)},
    "voxel_difference": {"voxel_size": (0.02, 0.05, 0.1, 0.2)},
}
"""Keys of a detector's section and their values. `structural_matching` has its own rule, see `thresholds`."""


def settings_of(detector: str) -> list[dict[str, Any]]:
    """Every combination of the values in a detector's grid, as dotted keys of a configuration."""
    grid: Mapping[str, tuple[Any, ...]] = GRIDS[detector]
    keys = [f"{detector}.{key}" for key in grid]
    return [dict(zip(keys, values, strict=True)) for values in itertools.product(*grid.values())]
