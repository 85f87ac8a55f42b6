"""Unbalanced transport: what finds no partner is new or gone, whatever the size of the rest."""

import numpy as np
import pytest
import torch

from gmmtorch import FitResult, GaussianMixtures
from novelty.detectors import UnbalancedEmd
from novelty.fitting import Fit, FitPlan, Models
from novelty.preprocess import PreparedPairs, Preprocess, prepare
from novelty.scan import Scan

PLAN = FitPlan(settings=Fit(initializer="kmeans++"), max_components=6, seed=0)
PLACES = ((0, 0, 0), (3, 0, 0), (0, 3, 0), (3, 3, 0))

each_fit = pytest.mark.parametrize("fits", ["shared", "coupled", "independent"])
each_distance = pytest.mark.parametrize("ground_distance", ["hellinger", "mean", "bures", "combined"])


def blobs(places, seed, size=400):
    rng = np.random.default_rng(seed)
    return np.concatenate([place + 0.2 * rng.normal(size=(size, 3)) for place in places])


def pairs(*scans):
    settings = Preprocess(outliers="none", ground="none")
    sides = (prepare([Scan(points) for points in side], settings) for side in zip(*scans, strict=True))
    return PreparedPairs(*sides)


def answer(detector, batch):
    models = detector.fit(batch, PLAN)
    return models, detector.compare(batch, models)


def label(batch, models, novelty):
    components = models.current.mixtures.assign(batch.current.points)
    return novelty.novel[batch.current.points.cloud_index, components].numpy()


def one_per_place(places):
    """A mixture of one round component per place, as a fit."""
    k = len(places)
    mixtures = GaussianMixtures.from_arrays(
        torch.full((k,), 1 / k), torch.tensor(places), 0.04 * torch.eye(3).expand(k, 3, 3)
    )
    zero = torch.zeros(1, dtype=torch.float64)
    return FitResult(mixtures, zero, zero[:, None], zero, zero.long(), zero.long())


@each_fit
@each_distance
def test_what_is_new_and_what_is_gone_come_from_one_solution(fits, ground_distance):
    detector = UnbalancedEmd(fits=fits, ground_distance=ground_distance)
    batch = pairs((blobs(PLACES, 0), blobs([*PLACES[:3], (6, 6, 0)], 1)))
    models, found = answer(detector, batch)
    last = np.repeat([False, True], [1200, 400])
    assert (label(batch, models, found.added) == last).all()
    assert (label(batch.exchanged(), models.exchanged(), found.removed) == last).all()


@pytest.mark.parametrize("fits", ["shared", "coupled"])
def test_a_large_new_thing_removes_nothing(fits):
    """Weights brought to a total of 1 would call most of the old places removed."""
    new = blobs([(9, 9, 0)], 5, size=4000)
    batch = pairs((blobs(PLACES, 0), np.concatenate([blobs(PLACES, 1), new])))
    models, found = answer(UnbalancedEmd(fits=fits), batch)
    assert (label(batch, models, found.added) == np.repeat([False, True], [1600, 4000])).all()
    assert not found.removed.novel.any()


def test_unmatched_share_of_given_mixtures():
    """Three of four places are kept at no cost; the fourth costs 2 tau a point, tau half of 0.7 spacings of 3 m."""
    batch = pairs((blobs(PLACES, 0), blobs([*PLACES[:3], (6, 6, 0)], 1)))
    models = Models(one_per_place([[0.0, 0, 0], [3, 0, 0], [0, 3, 0], [3, 3, 0]]),
                    one_per_place([[0.0, 0, 0], [3, 0, 0], [0, 3, 0], [6, 6, 0]]))  # fmt: skip
    detector = UnbalancedEmd(ground_distance="mean")
    found = detector.compare(batch, models)
    torch.testing.assert_close(found.added.scores, torch.tensor([[0.0, 0, 0, 1]], dtype=torch.float64))
    torch.testing.assert_close(found.removed.scores, torch.tensor([[0.0, 0, 0, 1]], dtype=torch.float64))
    assert found.added.matches.tolist() == [[0, 1, 2, -1]]
    assert found.distance.item() == pytest.approx(2 * 400 * 0.5 * 0.7 * 3.0)
    assert found.added.reasons[0][3].startswith("Novel: 100% of it finds no partner")


@each_distance
def test_the_unit_of_the_scene_does_not_matter(ground_distance):
    before, after = blobs(PLACES, 0), blobs([*PLACES, (6, 0, 0)], 1)
    batch = pairs((before, after), (50 * before, 50 * after))
    _, found = answer(UnbalancedEmd(ground_distance=ground_distance), batch)
    assert found.added.novel.any()
    if ground_distance != "combined":  # it weighs metres against a pure number
        torch.testing.assert_close(found.added.scores[0], found.added.scores[1], atol=1e-3, rtol=0)


def test_roles_exchange_and_pairs_do_not_disturb_each_other():
    scans = [
        (blobs(PLACES, 0), blobs(PLACES[:3], 1)),
        (blobs(PLACES, 2)[::2], blobs([*PLACES, (6, 0, 0)], 3)),
        (np.full((3, 3), np.nan), blobs(PLACES, 4)),
    ]
    detector, batch = UnbalancedEmd(), pairs(*scans)
    models, together = answer(detector, batch)
    back = detector.compare(batch.exchanged(), models.exchanged())
    torch.testing.assert_close(back.added.scores, together.removed.scores, equal_nan=True)
    torch.testing.assert_close(back.distance, together.distance, equal_nan=True)
    for p, scan in enumerate(scans):
        alone = answer(detector, pairs(scan))[1]
        assert alone.added.reasons[0] == together.added.reasons[p]
        torch.testing.assert_close(alone.distance[0], together.distance[p], equal_nan=True)
    assert not together.added.novel[2].any()
    assert together.distance[2].isnan()
    assert "reference" in together.notes[2][0]
