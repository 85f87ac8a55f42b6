"""A small sweep on disk: two places of one simulated scene, a few settings."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from novelty.sweep.sweep import Sweep

SMALL = {
    "data": {
        "rooms": {
            "setup": {"scene": "room", "changes": ["box"], "noise": 0.01, "density": 0.02},
            "seed": 1,
            "count": 2,
        }
    },
    "grid": {"max_components": [4, 8], "detector": ["likelihood", "structural_matching"]},
}


@pytest.fixture
def small() -> Sweep:
    """Two pairs of 2 000 points a scan under four settings."""
    return Sweep.from_mapping(SMALL)


@pytest.fixture
def small_file(tmp_path: Path) -> Path:
    """The same as a file."""
    file = tmp_path / "small.yaml"
    file.write_text(yaml.safe_dump(SMALL))
    return file
