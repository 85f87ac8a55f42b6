"""Fixtures that all tests share: the folder of real scans, and repeatable random numbers."""

import os
from pathlib import Path

os.environ.setdefault(
    "OMP_WAIT_POLICY", "PASSIVE"
)  # before torch: idle threads must not spin on a busy machine

import hypothesis
import numpy as np
import pytest

hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")

DEFAULT_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real scans; the test is skipped where there is none."""
    folder = Path(os.environ.get("NOVELTY_DATA", DEFAULT_DATA))
    if not folder.is_dir():
        pytest.skip(f"no real scans in {folder}; set NOVELTY_DATA to the folder that holds them")
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers, the same for every test."""
    return np.random.default_rng(20121214)
