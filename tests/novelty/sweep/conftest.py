"""A small sweep: labelled pairs of one simulated room, a few settings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from novelty.io import write_ply
from novelty.simulation import simulate_pair
from novelty.sweep.sweep import Sweep

NUM_PAIRS = 16


@pytest.fixture(scope="session")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`room-0` to `room-15`, of two different pairs in turn; 2 000 points a scan."""
    folder = tmp_path_factory.mktemp("rooms")
    for seed in (1, 2):
        pair = simulate_pair("room", seed, ("box",), noise=0.01, density=0.02).scans
        write_ply(folder / f"{seed}-before.ply", pair.reference.points, label=pair.reference.labels)
        write_ply(folder / f"{seed}-after.ply", pair.current.points, label=pair.current.labels)
    seeds = [1 + number % 2 for number in range(NUM_PAIRS)]
    lines = [f"room-{n},{seed}-before.ply,{seed}-after.ply" for n, seed in enumerate(seeds)]
    (folder / "pairs.csv").write_text("\n".join(["name,reference,current", *lines]))
    return folder / "pairs.csv"


@pytest.fixture(scope="session")
def small_mapping(manifest: Path) -> dict[str, Any]:
    """Two pairs under four settings."""
    return {
        "data": {"rooms": {"pairs": str(manifest), "count": 2}},
        "grid": {"max_components": [4, 8], "detector": ["likelihood", "structural_matching"]},
    }


@pytest.fixture(scope="session")
def small(small_mapping: dict[str, Any]) -> Sweep:
    """The same as a sweep."""
    return Sweep.from_mapping(small_mapping)


@pytest.fixture
def small_file(tmp_path: Path, small_mapping: dict[str, Any]) -> Path:
    """The same as a file."""
    file = tmp_path / "small.yaml"
    file.write_text(yaml.safe_dump(small_mapping))
    return file
