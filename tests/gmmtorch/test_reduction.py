"""The order search: its steps against plain loops and gmcluster, its path, and its behaviour on a batch."""

import gmcluster.gmcluster as bouman
import numpy as np
import pytest
import torch

from gmmtorch import (
    ArgumentError,
    GaussianMixtures,
    PointClouds,
    ShapeError,
    Status,
    description_length,
    fit_em,
    fit_mdl,
)
from gmmtorch.components import Components
from gmmtorch.criteria import CRITERIA, merge_saving
from gmmtorch.merging import merge_by_tensor_operations, merge_closest_pair, merge_distances
from tests.helpers import blobs, hostile_clouds, mixture_parameters, room
from tests.reference import em as naive


def components_of(mixture):
    return Components.create(*(torch.as_tensor(v)[None] for v in mixture))


@pytest.mark.parametrize("dim", [1, 2, 3, 6])
def test_merge_agrees_with_plain_loops(dim):
    mixture = naive.Mixture(*mixture_parameters(7, dim, seed=dim))
    total = torch.tensor([1234.0], dtype=torch.float64)
    components = components_of(mixture)
    pairs = [(a, b) for a in range(7) for b in range(a + 1, 7)]
    expected = [naive.merge_distance(mixture, a, b, 1234.0) for a, b in pairs]
    np.testing.assert_allclose(merge_distances(components, total)[0].numpy(), expected, rtol=1e-10)
    merged = merge_closest_pair(components, total, torch.tensor([True])).compact(6)
    for got, want in zip(
        (merged.weights, merged.means, merged.covariances), naive.merge_closest(mixture, 1234.0), strict=True
    ):
        np.testing.assert_allclose(got[0].numpy(), want, rtol=1e-12)


def test_merge_agrees_with_gmcluster():
    points = blobs(800, 3, 5)
    theirs = bouman.init_mixture(points, 6, "full", 1e-6)
    theirs, _ = bouman.E_step(theirs, points)
    theirs = bouman.M_step(theirs, points, "full", 1e-9)
    arrays = [np.array([getattr(c, n) for c in theirs.cluster]) for n in ("pb", "mu", "R")]
    components = components_of(naive.Mixture(arrays[0], arrays[1][..., 0], arrays[2]))
    total = torch.tensor([800.0], dtype=torch.float64)
    ours = merge_closest_pair(components, total, torch.tensor([True])).compact(5)
    theirs = bouman.MDL_reduce_order(theirs, False)
    np.testing.assert_allclose(ours.weights[0].numpy(), [c.pb for c in theirs.cluster], rtol=1e-9)
    np.testing.assert_allclose(ours.means[0].numpy(), [c.mu[:, 0] for c in theirs.cluster], atol=1e-9)
    np.testing.assert_allclose(ours.covariances[0].numpy(), [c.R for c in theirs.cluster], atol=1e-9)


def test_merging_preserves_the_moments_and_spares_the_others():
    mixture = components_of(naive.Mixture(*mixture_parameters(6, 3)))
    both = Components(
        *(torch.cat([t, t]) for t in (mixture.weights, mixture.means, mixture.covariances, mixture.factors))
    )
    merged = merge_closest_pair(
        both, torch.full((2,), 100.0, dtype=torch.float64), torch.tensor([True, False])
    )
    assert merged.num_components.tolist() == [5, 6]
    assert torch.equal(merged.means[1], both.means[1])

    def moments(c, b):
        mean = c.weights[b] @ c.means[b]
        away = c.means[b] - mean
        return mean, (
            c.weights[b, :, None, None] * (c.covariances[b] + away[:, :, None] * away[:, None, :])
        ).sum(0)

    for before, after in zip(moments(both, 0), moments(merged, 0), strict=True):
        torch.testing.assert_close(before, after, rtol=1e-12, atol=1e-12)


def test_description_lengths():
    points = room(900)
    clouds = PointClouds.from_list([points])
    result = fit_mdl(clouds, 8, return_path=True)
    for k, mixture in enumerate(result.path, start=1):
        assert mixture.num_components.tolist() == [k]
        log_likelihood = float(mixture.log_prob(clouds).sum())
        expected = naive.description_length(log_likelihood, k, 900, 3)
        assert float(result.mdl_path[0, k - 1]) == pytest.approx(expected, rel=1e-11)
    assert float(result.mdl[0]) == float(result.mdl_path[0].min())
    assert int(result.mixtures.num_components[0]) == int(result.mdl_path[0].argmin()) + 1
    assert float(description_length(result.mixtures, clouds)[0]) == pytest.approx(
        float(result.mdl[0]), rel=1e-11
    )


def test_gmcluster_values_the_same_mixture_alike():
    points = room(1200)
    theirs, info = bouman.GMModel.estimate(points, max_clusters=6, alpha=1e-3, return_info=True)
    mixtures = GaussianMixtures.from_arrays(theirs.weights, theirs.means, theirs.covariances)
    assert float(description_length(mixtures, PointClouds.from_list([points]))[0]) == pytest.approx(
        info.mdl, rel=1e-10
    )


@pytest.mark.parametrize("criterion", sorted(CRITERIA))
def test_finds_the_order_of_well_separated_components(criterion):
    rng = np.random.default_rng(3)
    centers = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9], [9, 9, 9]])
    points = centers[rng.integers(0, 5, 3000)] + rng.normal(size=(3000, 3))
    result = fit_mdl(PointClouds.from_list([points]), 12, initializer="kmeans++", criterion=criterion)
    assert result.mixtures.num_components.tolist() == [5]


def test_one_round_less_costs_no_more_than_the_merge():
    """MDL(K-1) - MDL(K) <= d(l, m) - (1 + D + D (D + 1) / 2) / 2 log(N D) + what EM still gained at K."""
    clouds = PointClouds.from_list([room(1000)])
    state = fit_em(clouds, 10, tolerance=1e-7, max_iterations=5000)
    mixture = components_of(
        [t[0] for t in (state.mixtures.weights, state.mixtures.means, state.mixtures.covariances)]
    )
    total = clouds.total_weights
    saving = float(merge_saving(total, 3)[0])
    for order in range(10, 1, -1):
        distance = float(merge_distances(mixture, total).min())
        merged = merge_closest_pair(mixture, total, torch.tensor([True])).compact(order - 1)
        start = GaussianMixtures.from_arrays(merged.weights, merged.means, merged.covariances)
        after = fit_em(clouds, initial=start, tolerance=1e-7, max_iterations=5000)
        assert int(after.mixtures.num_components[0]) == order - 1
        parameters = 10 * order - 1, 10 * (order - 1) - 1
        before_mdl, after_mdl = (
            -float(s.objective[0]) + 0.5 * n * np.log(3000)
            for s, n in zip((state, after), parameters, strict=True)
        )
        assert after_mdl - before_mdl <= distance - saving + 1e-3
        state = after
        mixture = components_of(
            [
                t[0, : order - 1]
                for t in (after.mixtures.weights, after.mixtures.means, after.mixtures.covariances)
            ]
        )


def test_a_batch_equals_its_members_in_any_order():
    named = {**hostile_clouds(), "room": room(1500), "small room": room(300, 1)}
    names = list(named)
    orders = [3 + i % 7 for i in range(len(names))]
    together = fit_mdl(PointClouds.from_list(list(named.values())), orders)
    backwards = fit_mdl(PointClouds.from_list(list(named.values())[::-1]), orders[::-1])
    for b, name in enumerate(names):
        alone = fit_mdl(PointClouds.from_list([named[name]]), orders[b])
        for other, row in ((backwards, len(names) - 1 - b), (alone, 0)):
            count = int(together.mixtures.num_components[b])
            assert int(other.mixtures.num_components[row]) == count, name
            assert int(other.status[row]) == int(together.status[b]), name
            assert torch.equal(other.mdl[row], together.mdl[b]), name
            assert torch.equal(other.mixtures.means[row, :count], together.mixtures.means[b, :count]), name
            mine, theirs = together.mdl_path[b, : orders[b]], other.mdl_path[row, : orders[b]]
            assert torch.equal(mine.nan_to_num(-1.0), theirs.nan_to_num(-1.0)), name


def test_the_path_has_nan_where_an_order_was_not_reached():
    result = fit_mdl(PointClouds.from_list([room(400), blobs(4), np.zeros((0, 3))]), [4, 9, 9])
    assert result.mdl_path.shape == (3, 9)
    reached = result.mdl_path.isfinite()
    assert reached[0].tolist() == [True] * 4 + [False] * 5
    assert reached[1].tolist() == [True] * 4 + [False] * 5
    assert not reached[2].any()
    assert result.status.tolist() == [Status.OK, Status.FEWER_POINTS_THAN_COMPONENTS, Status.EMPTY]
    assert float(result.mdl[2]) == 0.0


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_hostile_clouds_give_numbers(dtype):
    clouds = PointClouds.from_list(list(hostile_clouds().values()), dtype=dtype)
    result = fit_mdl(clouds, 5, n_init=2, initializer="kmeans++")
    for tensor in (result.mixtures.means, result.mixtures.covariances, result.mdl, result.log_likelihood):
        assert torch.isfinite(tensor).all()
    has_mixture = [Status(s).has_mixture for s in result.status.tolist()]
    assert (result.mixtures.num_components > 0).tolist() == has_mixture


def test_float32_chooses_like_float64():
    points = [room(4000, seed) for seed in range(10)]
    double, single = (
        fit_mdl(PointClouds.from_list(points, dtype=d), 12) for d in (torch.float64, torch.float32)
    )
    same_order = double.mixtures.num_components == single.mixtures.num_components
    close = (double.mdl - single.mdl).abs() <= merge_saving(torch.full((10,), 4000.0), 3)
    assert (same_order & close).sum() >= 9  # of ten: a plateau of EM may be left in another direction


def test_more_initialisations_are_never_worse():
    clouds = PointClouds.from_list([room(1000), room(600, 3)])
    one = fit_mdl(clouds, 8, initializer="kmeans++", n_init=1)
    four = fit_mdl(clouds, 8, initializer="kmeans++", n_init=4)
    assert (four.mdl <= one.mdl).all()
    assert (four.mdl < one.mdl).any()


def test_no_worse_than_gmcluster():
    """Mean description length over rooms, in a fraction of gmcluster's time even with four initialisations."""
    points = [room(2000, seed + 50) for seed in range(3)]
    clouds = PointClouds.from_list(points)
    models = [bouman.GMModel.estimate(x, max_clusters=12, alpha=1e-3) for x in points]
    theirs = GaussianMixtures.from_list(
        [GaussianMixtures.from_arrays(m.weights, m.means, m.covariances) for m in models]
    )
    ours = fit_mdl(clouds, 12, n_init=4, initializer="kmeans++")
    assert float(ours.mdl.mean()) <= float(description_length(theirs, clouds).mean())


def test_bad_options_are_named():
    clouds = PointClouds.from_list([room(50)])
    with pytest.raises(ArgumentError, match="criterion"):
        fit_mdl(clouds, 3, criterion="aic")
    with pytest.raises(ArgumentError, match="n_init"):
        fit_mdl(clouds, 3, n_init=0)
    with pytest.raises(ArgumentError, match="at least 1"):
        fit_mdl(clouds, 0)


def test_several_fits_of_one_cloud_equal_single_ones():
    clouds = PointClouds.from_list([room(900), room(1500, 1)])
    members, orders = [1, 0, 1, 1], [3, 8, 5, 10]
    together = fit_mdl(clouds, orders, members=members, n_init=3, initializer="kmeans++")
    for i, (b, order) in enumerate(zip(members, orders, strict=True)):
        alone = fit_mdl(clouds[b], order, n_init=3, initializer="kmeans++")
        assert torch.equal(alone.mdl[0], together.mdl[i])
        assert torch.equal(alone.mixtures.means[0], together.mixtures.means[i, : alone.mixtures.num_slots])


@pytest.mark.parametrize("by_tensor_operations", [False, True])
def test_both_ways_of_merging_agree(by_tensor_operations):
    """Clouds that shrink and others that stay, absent components, D from 1 to 4."""
    for dim in (1, 3, 4):
        parts = [mixture_parameters(5, dim, seed=s) for s in range(3)]
        weights, means, covariances = (
            torch.from_numpy(np.stack(values)) for values in zip(*parts, strict=True)
        )
        weights[1, 2] = 0.0
        components = Components.create(weights, means, covariances)
        total, shrinking = torch.tensor([100.0, 5.0, 1e4]).double(), torch.tensor([True, True, False])
        naive_pairs = [merge_distances(components, total)[b].argmin() for b in (0, 1)]
        merge = merge_by_tensor_operations if by_tensor_operations else merge_closest_pair
        merged = merge(components, total, shrinking)
        left, right = torch.triu_indices(5, 5, 1)
        for b, pair in enumerate(naive_pairs):
            assert merged.weights[b, right[pair]] == 0
            torch.testing.assert_close(merged.weights[b].sum(), torch.ones(()).double())
            share = components.weights[b, [left[pair], right[pair]]].sum()
            torch.testing.assert_close(merged.weights[b, left[pair]], share)
        assert torch.equal(merged.means[2], components.means[2])
        other = merge_by_tensor_operations(components, total, shrinking)
        for name in ("weights", "means", "covariances", "factors"):
            torch.testing.assert_close(getattr(merged, name), getattr(other, name))


def test_seeds_and_orders_are_members_of_one_batch():
    scan = PointClouds.from_list([room(1500), blobs(400)])
    orders, seeds, members = [4, 6, 4, 6, 5], [0, 0, 3, 3, 7], [0, 0, 0, 0, 1]
    options = {"initializer": "random_points", "n_init": 2}
    together = fit_mdl(scan, orders, seed=seeds, members=members, **options)
    for i, (order, seed, member) in enumerate(zip(orders, seeds, members, strict=True)):
        alone = fit_mdl(scan[member], order, seed=seed, **options)
        assert torch.equal(alone.mdl, together.mdl[i : i + 1])
    assert len(set(together.mdl[:4].tolist())) == 4
    with pytest.raises(ShapeError, match="one per fit"):
        fit_mdl(scan, 3, seed=[1, 2, 3])
