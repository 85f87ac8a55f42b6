"""What the other scan does not explain, and scores measured on a scan's own halves."""

import numpy as np
import pytest
import torch
from scipy.stats import false_discovery_control

from gmmtorch import GaussianMixtures, PointClouds
from novelty import Scan, ScanPair
from novelty.detectors.held_out import DealtCells, HeldOutScores, tail_p_values
from novelty.detectors.likelihood import _stray
from novelty.detectors.p_values import discoveries
from novelty.detectors.unexplained import _squared_norms, find_unexplained
from novelty.fitting import Fit, FitPlan, fit_independently, fitted_clouds
from novelty.preprocess import Preprocess, prepare_pairs

PLAIN = Preprocess(outliers="none", ground="none")


def floor(seed, count=6000):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0, 4, (count, 2)), rng.normal(0, 0.005, count)])


def box(seed, centre, count=800, side=0.3):
    return np.asarray(centre) + np.random.default_rng(seed).uniform(-side / 2, side / 2, (count, 3))


def batch_of(reference, current):
    return prepare_pairs([ScanPair(Scan(reference), Scan(current))], PLAIN)


def clouds_of(batch):
    return batch.reference.cells, batch.current.cells


def test_what_is_new_gets_one_component_and_what_is_gone_another():
    batch = batch_of(
        np.vstack([floor(0), box(2, (1, 1, 0.6))]),
        np.vstack([floor(1), box(3, (3, 3, 0.6)), box(4, (3, 1, 0.6), 300)]),
    )
    gone, new = find_unexplained(batch, clouds_of(batch), 16)
    assert (gone.groups.counts > 0).sum() == 1
    assert (new.groups.counts > 0).sum() == 2
    np.testing.assert_allclose(gone.groups.means[0, 0], (1, 1, 0.6), atol=0.03)
    np.testing.assert_allclose(new.groups.means[0], [(3, 3, 0.6), (3, 1, 0.6)], atol=0.03)
    np.testing.assert_allclose(new.groups.covariances[0, 0], 0.3**2 / 12 * np.eye(3), atol=2e-3)
    assert new.groups.counts[0].sum() > 0.95 * 1100
    assert new.explained(batch.current.cells).total_weights < 6100


@pytest.mark.parametrize("most_groups", [0, 16])
def test_the_same_scene_twice_leaves_nothing_unexplained(most_groups):
    batch = batch_of(floor(0), floor(1))
    for side in find_unexplained(batch, clouds_of(batch), most_groups):
        assert (side.groups.counts > 0).sum() == 0
        assert side.cells.double().mean() <= 0.002


def test_an_empty_scan_leaves_everything_explained():
    batch = batch_of(floor(0), floor(1))
    empty = batch.reference.cells
    nothing = PointClouds(empty.points[:0], empty.weights[:0], empty.spreads[:0], (0, 0), empty.dtype)
    object.__setattr__(batch.reference, "cells", nothing)
    gone, new = find_unexplained(batch, clouds_of(batch), 16)
    assert len(gone.cells) == 0
    assert not new.cells.any()


def test_norms_by_cofactors_agree_with_solving(rng):
    roots = rng.normal(size=(50, 3, 3)) * [1.0, 0.1, 0.01]
    covariances = roots @ roots.transpose(0, 2, 1) + 1e-6 * np.eye(3)
    offsets = rng.normal(size=(50, 3))
    expected = np.einsum("ni,ni->n", offsets, np.linalg.solve(covariances, offsets[..., None])[..., 0])
    np.testing.assert_allclose(_squared_norms(offsets, covariances), expected, rtol=1e-8)


def test_discoveries_agree_with_scipy(rng):
    p_values = torch.from_numpy(rng.uniform(0, 1, (40, 12)) ** 3)
    expected = np.stack([false_discovery_control(row) <= 0.1 for row in p_values.numpy()])
    np.testing.assert_array_equal(discoveries(p_values, 0.1), expected)
    with_padding = torch.cat([p_values, torch.full((40, 3), torch.nan, dtype=torch.float64)], 1)
    np.testing.assert_array_equal(discoveries(with_padding, 0.1)[:, :12], expected)
    assert not discoveries(with_padding, 0.1)[:, 12:].any()


def test_held_out_scores_centre_on_zero_and_give_large_scores_small_p_values():
    batch = batch_of(floor(0), floor(1))
    models = fit_independently(batch, FitPlan(Fit(), 6))
    dealt, mixtures = DealtCells.of(batch.reference.cells, 5), models.reference.mixtures
    null = HeldOutScores.of(dealt, mixtures, mixtures.posterior(dealt.cells), torch.tensor([0.05]), 5)
    assert len(null.scores[0]) > 100
    assert abs(float(null.scores[0].median())) < 0.1
    asked = torch.tensor([[-100.0, 100.0, torch.nan]], dtype=torch.float64)
    p_values = null.p_values(asked, torch.zeros(1, dtype=torch.float64))[0]
    assert p_values[0] == 1
    assert p_values[1] < 1e-9
    assert p_values[2].isnan()


def test_scores_that_stray_make_high_ones_less_improbable():
    null = HeldOutScores(
        (torch.randn(1000, generator=torch.Generator().manual_seed(0), dtype=torch.float64).sort().values,)
    )
    scores = torch.tensor([[0.0, 3.0, 40.0, torch.nan]], dtype=torch.float64)
    still, stirred = (null.p_values(scores, torch.tensor([s], dtype=torch.float64))[0] for s in (0.0, 2.0))
    assert still[1] < 0.01
    # The sum of two Gaussians of 1 and 2: 3 is 1.34 standard deviations.
    assert abs(stirred[1] - 0.09) < 0.01
    assert abs(stirred[0] - 0.5) < 0.05
    assert still[2] < stirred[2] < 1e-6
    assert stirred[3].isnan()


def test_a_few_changed_components_do_not_make_all_of_them_stray():
    usual = torch.linspace(-1, 1, 21, dtype=torch.float64)
    scores = torch.cat([usual, torch.full((5,), 50.0), torch.full((2,), torch.nan)])[None]
    assert 0.5 < float(_stray(scores)) < 1.3
    assert float(_stray(torch.full((1, 3), torch.nan))) == 0.0


def test_a_thing_of_a_few_cells_is_not_taken_for_chance_because_one_half_lacks_it():
    batch = batch_of(np.vstack([floor(0), box(2, (1, 1, 0.6), 60, 0.1)]), floor(1))
    dealt = DealtCells.of(batch.reference.cells, 5)
    mixtures = GaussianMixtures(
        weights=torch.tensor([[0.99, 0.01]], dtype=torch.float64),
        means=torch.tensor([[[2, 2, 0], [1, 1, 0.6]]], dtype=torch.float64),
        covariances=torch.diag_embed(
            torch.tensor([[[1.3, 1.3, 1e-4], [1e-3, 1e-3, 1e-3]]], dtype=torch.float64)
        ),
        num_components=torch.tensor([2]),
    )
    posterior = mixtures.posterior(dealt.cells)
    assert 0 < (posterior.components == 1).sum() < 10  # fewer than two blocks
    null = HeldOutScores.of(dealt, mixtures, posterior, torch.tensor([0.05]), 5)
    assert null.scores[0].max() < 1


def test_p_values_are_conformal_and_fall_exponentially_beyond_what_was_seen(rng):
    null = torch.from_numpy(np.sort(rng.exponential(2.0, 500)))
    asked = torch.tensor([-1.0, float(null[249]), float(null[-10]), 30.0, torch.nan], dtype=torch.float64)
    p_values = tail_p_values(null, asked)
    assert p_values[0] == 1
    assert p_values[1] == pytest.approx(252 / 501)
    assert p_values[2] == pytest.approx(11 / 501)
    assert 1e-9 < p_values[3] < 1e-4  # exp(-15) = 3e-7 is true
    assert p_values[4].isnan()
    few = tail_p_values(null[:15], asked[3:4])
    assert few[0] == pytest.approx(1 / 16)


def test_what_is_not_explained_is_counted_as_the_fit_counts():
    batch = batch_of(floor(0), np.vstack([floor(1), box(3, (3, 3, 0.6))]))
    centroids = tuple(
        fitted_clouds(scans, Fit(moments="centroid")) for scans in (batch.reference, batch.current)
    )
    _, new = find_unexplained(batch, centroids, 16)
    assert float(new.groups.counts.sum()) == int(new.cells.sum())
