"""What the other scan measured and preprocessing put aside is not new; what it never measured is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from novelty import Scan, ScanPair
from novelty.detectors import PointNovelty
from novelty.preprocess import Preprocess, prepare_pairs
from novelty.put_aside import _measured, drop_measured
from novelty.segment import label_points


def wall(seed, side=1.0, count=4000):
    plane = np.random.default_rng(seed).uniform(0, side, (count, 2))
    noise = np.random.default_rng(seed + 100).normal(0, 0.002, count)
    return np.column_stack([plane, noise])


def ball(seed, count, centre=(0.5, 0.5, 1.0), radius=0.1):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(centre) + radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize(("shift", "known"), [(0.0, True), (0.25, False)])
def test_returns_are_among_a_group_when_as_near_as_its_own_points(shift, known):
    group = ball(0, 300)
    returns = ball(1, 300, centre=(0.5, 0.5, 1.0 + shift))
    assert (_measured(group, np.zeros(300, np.int64), returns, 0.0) == known).all()


def test_few_strays_do_not_explain_a_dense_group():
    assert not _measured(ball(0, 500), np.zeros(500, np.int64), ball(1, 12), 0.0).any()


@pytest.mark.parametrize("put_aside", [True, False])
def test_groups_on_returns_that_were_put_aside_are_unchanged(put_aside):
    bare, full = wall(0), np.vstack([wall(0), ball(2, 300)])
    pair = ScanPair(Scan(bare), Scan(np.vstack([wall(1), ball(3, 300)])))
    batch = prepare_pairs([pair], Preprocess(outliers="none", ground="none"))
    measured = replace(batch.reference, returns=(full if put_aside else bare,))
    novel = torch.arange(4300) >= 4000
    segmented = label_points(batch.current.points, PointNovelty(novel, novel.double()))
    left = drop_measured(segmented, batch.current, measured, torch.tensor([0.001])).labels
    assert left.any() != put_aside
    assert torch.equal(left, novel & (not put_aside))
