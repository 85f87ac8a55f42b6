"""One mixture for both scans: splits where they differ, counts that say what is new, p-values that stay honest."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.stats import binom

from gmmtorch import GaussianMixtures
from novelty.detectors import JointMixture
from novelty.detectors.balance import log_density_ratio, pooled_counts
from novelty.detectors.joint_mixture import _Counts
from novelty.fitting import Fit, FitPlan, Models, fit_independently
from novelty.preprocess import PreparedPairs, Preprocess, prepare
from novelty.scan import Scan

PLAN = FitPlan(settings=Fit(initializer="kmeans++"), max_components=6, seed=0)
PLACES = ((0, 0, 0), (3, 0, 0), (0, 3, 0), (3, 3, 0))


def blobs(places, seed, size=400):
    rng = np.random.default_rng(seed)
    return np.concatenate([place + 0.2 * rng.normal(size=(size, 3)) for place in places])


def pairs(*scans):
    settings = Preprocess(outliers="none", ground="none")
    sides = (prepare([Scan(points) for points in side], settings) for side in zip(*scans, strict=True))
    return PreparedPairs(*sides)


def answer(detector, batch, plan=PLAN):
    models = detector.fit(batch, plan)
    return models, detector.compare(batch, models)


def label(batch, models, novelty):
    components = models.current.mixtures.assign(batch.current.points)
    return novelty.novel[batch.current.points.cloud_index, components].numpy()


def test_what_moved_by_its_own_size_is_new_here_and_gone_there():
    before = [*PLACES, (6, 0, 0)]
    after = [*PLACES, (6, 0.8, 0)]
    batch = pairs((blobs(before, 0), blobs(after, 1)))
    plan = replace(PLAN, max_components=5)  # MDL can only put both places into one component
    models, found = answer(JointMixture(max_splits=3), batch, plan)
    moved = np.repeat([False] * 4 + [True], 400)
    assert (label(batch, models, found.added) == moved).mean() > 0.99
    assert (label(batch.exchanged(), models.exchanged(), found.removed) == moved).mean() > 0.99
    common_only = replace(plan, settings=replace(plan.settings, unexplained_components=0))
    _, without_splits = answer(JointMixture(max_splits=0), batch, common_only)
    assert not without_splits.added.novel.any()


def test_a_density_common_to_all_is_no_change():
    batch = pairs((blobs(PLACES, 0, 1200), blobs(PLACES, 1, 200)))
    models, found = answer(JointMixture(), batch)
    assert not found.added.novel.any()
    assert not found.removed.novel.any()
    ratio = log_density_ratio(*pooled_counts(batch, models))
    assert ratio.item() == pytest.approx(-np.log(6), abs=0.05)


def test_a_large_new_thing_does_not_move_the_common_ratio():
    new = blobs([(9, 9, 0)], 5, size=4000)
    batch = pairs((blobs(PLACES, 0), np.concatenate([blobs(PLACES, 1), new])))
    models, found = answer(JointMixture(), batch)
    assert log_density_ratio(*pooled_counts(batch, models)).item() == pytest.approx(0.0, abs=0.1)
    assert (label(batch, models, found.added) == np.repeat([False, True], [1600, 4000])).all()


def test_exchanged_counts_have_the_opposite_ratio():
    own = torch.tensor([[3.0, 70.0, 500.0, 0.2]], dtype=torch.float64)
    other = torch.tensor([[5.0, 80.0, 20.0, 90.0]], dtype=torch.float64)
    assert log_density_ratio(own, other).item() == pytest.approx(-log_density_ratio(other, own).item())


def test_restless_scenes_need_stronger_evidence():
    """The more the unchanged components' counts stray, the higher the p-value of the same new thing."""
    new = blobs([(9, 9, 0)], 5, size=300)

    def least(sizes):
        current = np.concatenate([blobs([p], 1, n) for p, n in zip(PLACES, sizes, strict=True)] + [new])
        found = answer(JointMixture(), pairs((blobs(PLACES, 0), current)))[1]
        return found.p_value.item()

    assert least((400, 400, 400, 400)) < least((200, 800, 220, 700))


@pytest.mark.parametrize(("own", "other"), [(5, 0), (4, 0), (9, 2), (3, 3), (0, 6)])
def test_p_values_of_a_restful_scene_are_those_of_coins(own: int, other: int):
    own_cells, other_cells = (torch.tensor([[float(n)]], dtype=torch.float64) for n in (own, other))
    found = _Counts(own_cells, other_cells, torch.zeros(1, dtype=torch.float64)).p_values()
    assert found.item() == pytest.approx(binom.sf(own - 1, own + other, 0.5), abs=1e-8)


def test_independent_mixtures_are_pooled():
    batch = pairs((blobs(PLACES, 0), blobs([*PLACES, (6, 0, 0)], 1)))
    models = fit_independently(batch, PLAN)
    found = JointMixture().compare(batch, models)
    assert (label(batch, models, found.added) == np.repeat([False, True], [1600, 400])).all()
    assert not found.removed.novel.any()


def test_the_same_scan_twice_is_unchanged_with_even_shares():
    batch = pairs((blobs(PLACES, 0), blobs(PLACES, 0)))
    models, found = answer(JointMixture(), batch)
    scores = found.added.scores[models.current.mixtures.mask]
    torch.testing.assert_close(scores, torch.full_like(scores, 0.5), atol=1e-6, rtol=0)
    assert found.p_value.item() > 0.5


def test_roles_exchange_and_pairs_do_not_disturb_each_other():
    scans = [
        (blobs(PLACES, 0), blobs(PLACES[:3], 1)),
        (blobs(PLACES, 2)[::2], blobs([*PLACES, (6, 0, 0)], 3)),
        (np.full((3, 3), np.nan), blobs(PLACES, 4)),
    ]
    batch = pairs(*scans)
    models, together = answer(JointMixture(), batch)
    back = JointMixture().compare(batch.exchanged(), Models(models.current, models.reference))
    torch.testing.assert_close(back.added.scores, together.removed.scores, equal_nan=True)
    for p, scan in enumerate(scans):
        alone = answer(JointMixture(), pairs(scan))[1]
        assert alone.added.reasons[0] == together.added.reasons[p]
        assert alone.removed.reasons[0] == together.removed.reasons[p]
    assert not together.added.novel[2].any()
    assert "reference" in together.notes[2][0]
    assert together.p_value[2].isnan()


def test_shared_components_are_counted_as_if_each_stood_there_twice():
    batch = pairs((blobs([0, 5, 9], 1), blobs([0, 5, 20], 2)), (blobs([0], 3), blobs([0, 5], 4)))
    models = JointMixture().fit(batch, PLAN)
    sides = models.current.mixtures, models.reference.mixtures
    sizes = batch.current.cells.total_weights, batch.reference.cells.total_weights
    weights = torch.cat([m.weights * n[:, None] for m, n in zip(sides, sizes, strict=True)], 1)
    twice = GaussianMixtures(
        weights / weights.sum(1, keepdim=True),
        torch.cat([m.means for m in sides], 1),
        torch.cat([m.covariances for m in sides], 1),
        (weights > 0).sum(1),
    )
    for found, side in zip(pooled_counts(batch, models), (batch.current, batch.reference), strict=True):
        torch.testing.assert_close(found, twice.expected_counts(side.cells), rtol=1e-9, atol=1e-9)
