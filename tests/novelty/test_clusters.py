"""Novel points in contact."""

import numpy as np
import pytest
import torch

from novelty.clusters import novel_clusters
from novelty.preprocess import Preprocess, prepare_pairs
from novelty.scan import Scan, ScanPair

PLAIN = Preprocess(outliers="none", ground="none")


def blob(rng, centre, count=300):
    return rng.uniform(-0.2, 0.2, (count, 3)) + centre


@pytest.fixture
def prepared(rng):
    """Two blobs apart, the first of them in two halves in contact."""
    halves = np.concatenate([blob(rng, (0, 0, 0)), blob(rng, (0.4, 0, 0)), blob(rng, (3, 0, 0))])
    scan = Scan(halves)
    return prepare_pairs([ScanPair(scan, scan)], PLAIN, "m").current


def test_contact_makes_one_group_and_distance_two(prepared):
    groups = novel_clusters(prepared, torch.ones(900, dtype=torch.bool)).numpy()
    assert set(groups[:600]) == {0}
    assert set(groups[600:]) == {1}


def test_points_that_are_not_novel_are_in_no_group_and_join_nothing(prepared):
    novel = torch.ones(900, dtype=torch.bool)
    novel[300:600] = False
    groups = novel_clusters(prepared, novel).numpy()
    assert (groups[300:600] == -1).all()
    assert set(groups[:300]) == {0}


def test_without_novel_points_there_are_no_groups(prepared):
    assert (novel_clusters(prepared, torch.zeros(900, dtype=torch.bool)) == -1).all()


def test_scans_of_a_batch_are_grouped_apart(rng):
    scan = Scan(np.concatenate([blob(rng, (0, 0, 0)), blob(rng, (3, 0, 0))]))
    scans = prepare_pairs([ScanPair(scan, scan)] * 2, PLAIN, "m").current
    first, second = scans.points.split(novel_clusters(scans, torch.ones(1200, dtype=torch.bool)))
    assert torch.equal(first, second)
    assert first.max() == 1
