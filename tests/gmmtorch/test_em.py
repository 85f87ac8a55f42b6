"""EM against plain loops, scikit-learn and gmcluster, and the properties it must have."""

import gmcluster.gmcluster as bouman
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.mixture import GaussianMixture

from gmmtorch import ArgumentError, GaussianMixtures, PointClouds, ShapeError, Status, fit_em
from tests.helpers import blobs, hostile_clouds, mixture_parameters, room
from tests.reference import em as naive

DIMS = (1, 2, 3, 5, 10)


def start_for(points, num_components, seed=0):
    """Means at data points and the cloud's covariance, as arrays."""
    rng = np.random.default_rng(seed)
    means = points[rng.choice(len(points), num_components, replace=False)]
    covariance = np.atleast_2d(np.cov(points.T))
    return naive.Mixture(
        np.full(num_components, 1 / num_components), means, np.tile(covariance, (num_components, 1, 1))
    )


def as_mixture(mixtures, b=0):
    count = int(mixtures.num_components[b])
    return naive.Mixture(
        mixtures.weights[b, :count].numpy(),
        mixtures.means[b, :count].numpy(),
        mixtures.covariances[b, :count].numpy(),
    )


def random_cells(num_cells, dim, seed):
    rng = np.random.default_rng(seed)
    factors = 0.3 * rng.normal(size=(num_cells, dim, dim))
    return (
        blobs(num_cells, dim, seed=seed),
        rng.integers(1, 30, num_cells) * 1.0,
        factors @ factors.transpose(0, 2, 1),
    )


@pytest.mark.parametrize("dim", DIMS)
@pytest.mark.parametrize("num_components", [1, 3])
@pytest.mark.parametrize("cells", [False, True])
def test_three_steps_agree_with_plain_loops(dim, num_components, cells):
    points, weights, spreads = random_cells(60, dim, seed=dim)
    if not cells:
        weights, spreads = np.ones(60), np.zeros((60, dim, dim))
    expected = start = start_for(points, num_components)
    floor = 0.05
    with_floor = spreads + floor**2 * np.eye(dim)
    for _ in range(3):
        responsibilities, _ = naive.expectation(points, with_floor, expected)
        expected = naive.maximization(points, weights, with_floor, responsibilities)
    _, with_spread = naive.expectation(points, with_floor, expected)
    _, plain = naive.expectation(points, spreads, expected)
    clouds = PointClouds.from_list([points], [weights], [spreads])
    result = fit_em(
        clouds, initial=GaussianMixtures.from_arrays(*start), max_iterations=3, tolerance=None,
        min_std=floor, relative_floor=0.0,
    )  # fmt: skip
    for got, want in zip(as_mixture(result.mixtures), expected, strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-8, atol=1e-9)
    assert float(result.objective[0]) == pytest.approx(weights @ with_spread, rel=1e-11)
    assert float(result.log_likelihood[0]) == pytest.approx(weights @ plain, rel=1e-11)
    assert int(result.num_iterations[0]) == 3


@pytest.mark.parametrize(
    "points", [room(3000), blobs(2000, 4), room(2000) + 5e5], ids=["room", "blobs", "map"]
)
def test_agrees_with_scikit_learn_from_the_same_start(points):
    start = start_for(points, 6)
    theirs = GaussianMixture(
        6, weights_init=start.weights, means_init=start.means,
        precisions_init=np.linalg.inv(start.covariances), max_iter=20, tol=0.0, reg_covar=0.0,
    )  # fmt: skip
    with pytest.warns(Warning, match="converge"):
        theirs.fit(points)
    ours = fit_em(
        PointClouds.from_list([points]), initial=GaussianMixtures.from_arrays(*start),
        max_iterations=20, tolerance=None, relative_floor=0.0,
    )  # fmt: skip
    assert float(ours.log_likelihood[0]) / len(points) == pytest.approx(theirs.score(points), abs=1e-6)
    np.testing.assert_allclose(ours.mixtures.means[0].numpy(), theirs.means_, rtol=1e-5, atol=1e-5)


def test_e_and_m_steps_agree_with_gmcluster():
    points = room(1500)
    theirs = bouman.init_mixture(points, 5, "full", 1e-6)
    start = GaussianMixtures.from_arrays(
        np.array([c.pb for c in theirs.cluster]),
        np.array([c.mu[:, 0] for c in theirs.cluster]),
        np.array([c.R for c in theirs.cluster]),
    )
    for _ in range(4):
        theirs, _ = bouman.E_step(theirs, points)
        theirs = bouman.M_step(theirs, points, "full", 1e-9)
    _, log_likelihood = bouman.E_step(theirs, points)
    ours = fit_em(
        PointClouds.from_list([points]), initial=start, max_iterations=4, tolerance=None, relative_floor=0.0
    )
    assert float(ours.log_likelihood[0]) == pytest.approx(log_likelihood, rel=1e-9)
    np.testing.assert_allclose(ours.mixtures.weights[0].numpy(), [c.pb for c in theirs.cluster], rtol=1e-7)
    np.testing.assert_allclose(ours.mixtures.covariances[0].numpy(), [c.R for c in theirs.cluster], atol=1e-8)


@pytest.mark.parametrize(
    "points", [room(2000), *[hostile_clouds()[n] for n in ("coplanar", "duplicates", "far outlier")]]
)
def test_never_lowers_the_objective(points):
    clouds = PointClouds.from_list([points])
    values = [
        float(fit_em(clouds, 8, max_iterations=i, tolerance=None).objective[0])
        for i in (0, 1, 2, 3, 4, 8, 16, 17, 40)
    ]
    assert np.all(np.diff(values) >= -1e-9 * np.abs(values[1:]))


def test_the_papers_floor_can_lower_the_likelihood_and_ours_cannot():
    clouds = PointClouds.from_list([room(3000)])
    fitted = fit_em(clouds, 10, max_iterations=100, tolerance=1e-6).mixtures

    def gain(covariance_floor):
        before, after = (
            fit_em(
                clouds, initial=fitted, max_iterations=i, tolerance=None, covariance_floor=covariance_floor
            ).objective
            for i in (0, 1)
        )
        return float(after - before)

    assert gain("model") >= -1e-6
    assert gain("paper") < -0.1


def test_log_likelihood_is_that_of_the_mixture_returned():
    points, weights, spreads = random_cells(500, 3, seed=2)
    clouds = PointClouds.from_list(
        [points, room(700)], [weights, np.ones(700)], [spreads, np.zeros((700, 3, 3))]
    )
    result = fit_em(clouds, [3, 5], max_iterations=7)
    sums = [float(v.sum()) for v in clouds.split(clouds.weights * result.mixtures.log_prob(clouds))]
    np.testing.assert_allclose(result.log_likelihood.numpy(), sums, rtol=1e-11)


def test_splitting_a_cloud_into_its_cells_keeps_a_single_gaussian():
    points = blobs(1000, 3, 1)
    cells = points.reshape(50, 20, 3)
    spreads = np.array([np.cov(c.T, bias=True) for c in cells])
    whole = fit_em(PointClouds.from_list([points]), 1)
    parts = fit_em(PointClouds.from_list([cells.mean(1)], [np.full(50, 20.0)], [spreads]), 1, min_std=1e-9)
    torch.testing.assert_close(whole.mixtures.means, parts.mixtures.means, rtol=0, atol=1e-12)
    torch.testing.assert_close(whole.mixtures.covariances, parts.mixtures.covariances, rtol=1e-6, atol=1e-7)


def test_weights_count_as_repeated_points():
    points, times = room(300), np.random.default_rng(0).integers(0, 4, 300)
    start = GaussianMixtures.from_arrays(*start_for(points, 4))
    kwargs = {
        "initial": start,
        "max_iterations": 10,
        "tolerance": None,
        "min_std": 1e-3,
        "relative_floor": 0.0,
    }
    repeated = fit_em(PointClouds.from_list([np.repeat(points, times, axis=0)]), **kwargs)
    weighted = fit_em(PointClouds.from_list([points], [times]), **kwargs)
    torch.testing.assert_close(
        repeated.mixtures.covariances, weighted.mixtures.covariances, rtol=1e-8, atol=1e-10
    )
    torch.testing.assert_close(repeated.log_likelihood, weighted.log_likelihood, rtol=1e-10, atol=0)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_a_batch_equals_its_members_in_any_order(dtype):
    named = {**hostile_clouds(), "room": room(3000), "small room": room(700, 1)}
    names = list(named)
    together = fit_em(
        PointClouds.from_list([named[n] for n in names], dtype=dtype), 6, n_init=2, initializer="kmeans++"
    )
    order = np.random.default_rng(0).permutation(len(names))
    shuffled = fit_em(
        PointClouds.from_list([named[names[i]] for i in order], dtype=dtype),
        6,
        n_init=2,
        initializer="kmeans++",
    )
    for place, b in enumerate(order):
        alone = fit_em(
            PointClouds.from_list([named[names[b]]], dtype=dtype), 6, n_init=2, initializer="kmeans++"
        )
        for other, row in ((shuffled, place), (alone, 0)):
            assert int(together.status[b]) == int(other.status[row]), names[b]
            assert int(together.num_iterations[b]) == int(other.num_iterations[row]), names[b]
            count = int(together.mixtures.num_components[b])
            assert int(other.mixtures.num_components[row]) == count, names[b]
            for name in ("weights", "means", "covariances"):
                mine, theirs = (
                    getattr(r.mixtures, name)[i, :count] for r, i in ((together, b), (other, row))
                )
                assert torch.equal(mine, theirs), names[b]
            assert torch.equal(together.log_likelihood[b], other.log_likelihood[row]), names[b]


def test_the_same_seed_gives_the_same_bits():
    clouds = PointClouds.from_list([room(1000), room(400, 1)])
    first, second = (fit_em(clouds, 5, n_init=3, initializer="random_points", seed=4) for _ in range(2))
    assert torch.equal(first.mixtures.means, second.mixtures.means)
    other = fit_em(clouds, 5, n_init=3, initializer="random_points", seed=5)
    assert not torch.equal(first.mixtures.means, other.mixtures.means)


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("empty", Status.EMPTY),
        ("one point", Status.IDENTICAL_POINTS),
        ("fewer points than components", Status.FEWER_POINTS_THAN_COMPONENTS),
        ("all identical", Status.IDENTICAL_POINTS),
        ("coplanar", Status.FLOOR_REACHED),
        ("tilted plane", Status.FLOOR_REACHED),
        ("collinear", Status.FLOOR_REACHED),
        ("duplicates", Status.FLOOR_REACHED),
        ("not finite", Status.NON_FINITE),
        ("map coordinates", Status.OK),
        ("gigametres", Status.OK),
        ("nanometres", Status.OK),
    ],
)
def test_status_says_what_happened(name, status):
    result = fit_em(PointClouds.from_list([hostile_clouds()[name]]), 8, max_iterations=200)
    assert Status(int(result.status[0])) is status
    assert (int(result.mixtures.num_components[0]) > 0) == status.has_mixture


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_hostile_clouds_give_numbers(dtype):
    clouds = PointClouds.from_list(list(hostile_clouds().values()), dtype=dtype)
    result = fit_em(clouds, 6)
    for tensor in (
        result.mixtures.weights,
        result.mixtures.means,
        result.mixtures.covariances,
        result.log_likelihood,
    ):
        assert torch.isfinite(tensor).all()
    assert (torch.linalg.eigvalsh(result.mixtures.covariances) > 0).all()


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_scaling_a_cloud_scales_its_mixture(scale):
    points = room(600)
    plain, scaled = (fit_em(PointClouds.from_list([x]), 5) for x in (points, scale * points))
    torch.testing.assert_close(scaled.mixtures.means / scale, plain.mixtures.means, rtol=1e-9, atol=1e-9)
    expected = plain.log_likelihood - 3 * 600 * np.log(scale)
    torch.testing.assert_close(scaled.log_likelihood, expected, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("offset", [0.0, 20.0, 200.0, 5e5])
def test_float32_follows_float64(offset):
    points = [room(10_000, seed) + offset for seed in range(2)]
    start = fit_em(PointClouds.from_list(points), 20, max_iterations=0, tolerance=None).mixtures
    double, single = (
        fit_em(PointClouds.from_list(points, dtype=dtype), initial=start, max_iterations=50, tolerance=None)
        for dtype in (torch.float64, torch.float32)
    )
    clouds = PointClouds.from_list(points)
    values = [
        torch.stack([v.sum() for v in clouds.split(r.mixtures.log_prob(clouds))]) for r in (double, single)
    ]
    assert (values[0] - values[1]).abs().max() < 2.0


def test_float32_gains_are_not_negative():
    state = fit_em(PointClouds.from_list([room(30_000)]), 20, max_iterations=5, tolerance=None)
    clouds = PointClouds.from_list([room(30_000)], dtype=torch.float32)
    values, mixtures = [], state.mixtures
    for _ in range(25):
        result = fit_em(clouds, initial=mixtures, max_iterations=1, tolerance=None)
        mixtures = result.mixtures
        values.append(float(result.objective[0]))
    assert np.diff(values).min() > -0.1


def test_components_without_points_are_dropped():
    points = blobs(500, 3, 2)
    weights, means, covariances = mixture_parameters(3, 3)
    means[2] = 1e6
    start = GaussianMixtures.from_arrays(weights, means, covariances)
    result = fit_em(PointClouds.from_list([points]), initial=start)
    assert int(result.mixtures.num_components[0]) == 2
    assert float(result.mixtures.weights[0, 2]) == 0.0
    assert torch.equal(result.mixtures.covariances[0, 2], torch.eye(3, dtype=torch.float64))


def test_convergence_flags():
    clouds = PointClouds.from_list([room(2000), blobs(500, 3, 1)])
    short = fit_em(clouds, 6, max_iterations=1)
    assert short.status.tolist()[0] == Status.NOT_CONVERGED
    long = fit_em(clouds, 6, max_iterations=500)
    assert long.converged.all()
    assert (long.status == Status.OK).all()
    fixed = fit_em(clouds, 6, max_iterations=3, tolerance=None)
    assert not fixed.converged.any()
    assert fixed.num_iterations.tolist() == [3, 3]


def test_more_initialisations_are_never_worse():
    clouds = PointClouds.from_list([room(1500), room(900, 3)])
    one = fit_em(clouds, 8, initializer="kmeans++", n_init=1)
    five = fit_em(clouds, 8, initializer="kmeans++", n_init=5)
    assert (five.objective >= one.objective).all()
    assert (five.objective > one.objective).any()


@pytest.mark.parametrize(
    ("kwargs", "error"),
    [
        ({"num_components": 0}, ArgumentError),
        ({"num_components": [3, 3]}, ShapeError),
        ({"num_components": 3, "initializer": "kmean"}, ArgumentError),
        ({"num_components": 3, "relative_floor": -1.0}, ArgumentError),
        ({"num_components": 3, "covariance_floor": "none"}, ArgumentError),
        ({"num_components": 3, "max_iterations": -1}, ArgumentError),
        ({"num_components": 3, "tolerance": float("nan")}, ArgumentError),
        ({}, ArgumentError),
    ],
)
def test_bad_options_are_named(kwargs, error):
    with pytest.raises(error):
        fit_em(PointClouds.from_list([room(50)]), **kwargs)


@settings(max_examples=40)
@given(
    sizes=st.lists(st.integers(0, 40), min_size=1, max_size=4),
    dim=st.integers(1, 4),
    exponent=st.integers(-9, 9),
    flat=st.booleans(),
    repeats=st.integers(1, 3),
    components=st.integers(1, 6),
    single=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_any_batch_gives_numbers(sizes, dim, exponent, flat, repeats, components, single, seed):
    rng = np.random.default_rng(seed)
    points = [np.repeat(10.0**exponent * rng.normal(size=(n, dim)), repeats, axis=0) for n in sizes]
    if flat:
        points = [x * (np.arange(dim) > 0) for x in points]
    weights = [rng.integers(0, 3, len(x)) * 1.0 for x in points]
    spreads = [np.zeros((len(x), dim, dim)) for x in points]
    dtype = torch.float32 if single else torch.float64
    clouds = PointClouds.from_list(points, weights, spreads, dtype=dtype)
    result = fit_em(clouds, components, max_iterations=5, initializer="random_points", seed=seed)
    mixtures = result.mixtures
    for tensor in (
        mixtures.weights,
        mixtures.means,
        mixtures.covariances,
        result.log_likelihood,
        result.objective,
    ):
        assert torch.isfinite(tensor).all()
    assert (torch.linalg.eigvalsh(mixtures.covariances) >= 0).all()
    for b, w in enumerate(weights):
        assert (Status(int(result.status[b])) is Status.EMPTY) == (w.sum() == 0)
        assert float(mixtures.weights[b].sum()) == pytest.approx(float(w.sum() > 0))


ACCELERATED = {"room": room(3000), "blobs": blobs(2000, seed=4), "corridor": room(2000, 3) * [5.0, 0.5, 1.0]}


@pytest.mark.parametrize("name", ACCELERATED)
def test_accelerated_em_never_lowers_the_objective(name):
    clouds = PointClouds.from_list([ACCELERATED[name]])
    values = [
        float(fit_em(clouds, 8, max_iterations=i, tolerance=None, accelerate=True).objective[0])
        for i in range(1, 40)
    ]
    assert (np.diff(values) >= -1e-9 * abs(values[-1])).all()
    assert values[-1] > values[0] + 100


def test_accelerated_em_ends_where_a_step_of_ems_own_gains_nothing_more():
    clouds = PointClouds.from_list(list(ACCELERATED.values()))
    plain = fit_em(clouds, 8, max_iterations=5000, tolerance=1e-3)
    fast = fit_em(clouds, 8, max_iterations=5000, tolerance=1e-3, accelerate=True)
    again = fit_em(clouds, initial=fast.mixtures, max_iterations=1, tolerance=None)
    assert fast.converged.all()
    assert (again.objective - fast.objective < 2e-3).all()
    assert 1.4 * int(fast.num_iterations.sum()) < int(plain.num_iterations.sum())


def test_accelerated_em_of_a_batch_is_that_of_its_members():
    clouds = PointClouds.from_list([*ACCELERATED.values(), *hostile_clouds().values()])
    together = fit_em(clouds, 5, accelerate=True)
    for b in range(clouds.batch_size):
        alone = fit_em(clouds[b], 5, accelerate=True)
        count = alone.mixtures.weights.shape[1]
        assert torch.equal(together.mixtures.means[b, :count], alone.mixtures.means[0])
        assert torch.equal(together.num_iterations[b : b + 1], alone.num_iterations)
