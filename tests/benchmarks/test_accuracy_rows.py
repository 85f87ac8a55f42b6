"""The accuracy tables score what `detect_many` answers, though their variants share what stages they can."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.accuracy_rows import Case, Variant, row_of, scored
from novelty import Config, Scan, ScanPair, detect_many
from novelty.simulation import room_pair

VARIANTS = [
    Variant("default", Config()),
    Variant("unrefined", Config().replace(**{"refine.method": "none"})),
    Variant("K_max 8", Config(max_components=8)),
    Variant("with ground", Config().replace(**{"preprocess.ground": "none"})),
    Variant("greedy_emd, independent", Config(detector="greedy_emd").replace(**{"greedy_emd.fits": "independent"})),
    Variant("nearest_neighbour", Config(detector="nearest_neighbour")),
]  # fmt: skip


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    pairs = [room_pair(seed=seed, density=0.06) for seed in (3, 4)]
    return [Case("room", "none", seed, pair) for seed, pair in zip((3, 4), pairs, strict=True)]


def told(row) -> dict:
    """Everything in a row but the times."""
    return {k: v for k, v in vars(row).items() if not k.endswith("seconds")}


@pytest.mark.slow
def test_variants_that_share_stages_score_as_if_each_ran_alone(cases):
    rows = list(scored(cases, VARIANTS, batch_size=2))
    expected = [
        row_of(case, variant.name, result)
        for variant in VARIANTS
        for case, result in zip(cases, detect_many([c.pair for c in cases], variant.config), strict=True)
    ]
    assert [(row.variant, row.pair) for row in rows] == [(row.variant, row.pair) for row in expected]
    for row, other in zip(rows, expected, strict=True):
        assert told(row) == pytest.approx(told(other), abs=1e-12, nan_ok=True), row.variant
    assert len({row.kappa for row in rows}) > 3  # the variants are not one and the same


def test_a_scan_that_cannot_be_compared_is_a_row_with_its_reason(cases):
    broken = ScanPair(Scan(np.full((50, 3), np.nan)), cases[0].pair.current, "broken")
    rows = list(scored([cases[0], Case("room", "none", 0, broken)], VARIANTS[:2], batch_size=2))
    assert [bool(row.failure) for row in rows] == [False, True, False, True]
    assert math.isnan(rows[1].kappa)
