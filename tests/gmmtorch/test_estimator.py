"""The estimator against scikit-learn's own checks, its Gaussian mixture, and `fit_mdl`."""

import doctest
import pickle
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.mixture import GaussianMixture
from sklearn.utils.estimator_checks import check_dataframe_column_names_consistency, check_estimator

import gmmtorch
import gmmtorch.estimator
from gmmtorch import MDLGaussianMixture, PointClouds, Status, fit_mdl
from gmmtorch.estimator import EXPECTED_FAILED_CHECKS
from tests.helpers import blobs, room

DIMS = (1, 2, 3, 5, 10)


def as_scikit_learn(model):
    """scikit-learn's mixture with the same parameters."""
    theirs = GaussianMixture(model.n_components_)
    theirs.weights_, theirs.means_, theirs.covariances_ = model.weights_, model.means_, model.covariances_
    theirs.precisions_cholesky_ = np.linalg.inv(np.linalg.cholesky(model.covariances_)).transpose(0, 2, 1)
    return theirs


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("model", "expected"),
    [
        (MDLGaussianMixture(max_components=6), set()),
        (MDLGaussianMixture(max_components=6, criterion="mml"), set(EXPECTED_FAILED_CHECKS)),
    ],
    ids=["mdl", "mml"],
)
def test_scikit_learns_estimator_checks(model, expected):
    checks = check_estimator(model, on_fail=None, on_skip=None)
    assert len(checks) > 40
    assert {check["check_name"] for check in checks if check["status"] == "failed"} == expected


def test_names_of_columns_are_kept_and_checked():
    check_dataframe_column_names_consistency("MDLGaussianMixture", MDLGaussianMixture(max_components=3))
    frame = pd.DataFrame(blobs(60, 2), columns=["x", "y"])
    model = MDLGaussianMixture(max_components=3).fit(frame)
    assert model.feature_names_in_.tolist() == ["x", "y"]
    with pytest.raises(ValueError, match="feature names"):
        model.predict(frame[["y", "x"]])


@pytest.mark.parametrize("dim", DIMS)
@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_evaluates_as_scikit_learn_does(dim, offset):
    points = blobs(400, dim, seed=dim) + offset
    model = MDLGaussianMixture(max_components=5).fit(points)
    theirs, new = as_scikit_learn(model), blobs(50, dim, seed=dim + 1) + offset
    tolerance = {"rtol": 1e-10 * max(1.0, offset), "atol": 1e-10 * max(1.0, offset)}  # theirs does not centre
    np.testing.assert_allclose(model.score_samples(new), theirs.score_samples(new), **tolerance)
    np.testing.assert_allclose(model.predict_proba(new), theirs.predict_proba(new), **tolerance)
    np.testing.assert_array_equal(model.predict(new), theirs.predict(new))
    assert model.score(new) == pytest.approx(theirs.score(new), rel=tolerance["rtol"])
    assert model.bic(new) == pytest.approx(theirs.bic(new), rel=tolerance["rtol"])
    assert model.aic(new) == pytest.approx(theirs.aic(new), rel=tolerance["rtol"])
    assert model.means_.shape == (model.n_components_, dim)
    np.testing.assert_allclose(
        model.precisions_ @ model.covariances_, np.tile(np.eye(dim), (len(model.weights_), 1, 1)), atol=1e-8
    )


def test_is_fit_mdl_on_one_cloud():
    points = room(800)
    weights = np.random.default_rng(1).integers(1, 4, len(points))
    options = {"n_init": 2, "initializer": "kmeans++", "criterion": "bic", "min_std": 0.02}
    model = MDLGaussianMixture(8, random_state=5, **options).fit(points, sample_weight=weights)
    fit = fit_mdl(PointClouds.from_list([points], [weights]), 8, seed=5, **options)
    np.testing.assert_array_equal(model.means_, fit.mixtures.means[0])
    np.testing.assert_array_equal(model.mdl_path_, fit.mdl_path[0])
    np.testing.assert_array_equal(model.mixtures_.covariances, fit.mixtures.covariances)
    assert model.mdl_ == float(fit.mdl[0]) == np.nanmin(model.mdl_path_)
    assert model.n_iter_ == int(fit.num_iterations[0])
    assert model.status_ is Status(int(fit.status[0]))


def test_mdl_of_the_fitted_points_is_the_value_of_the_search():
    points = blobs(500)
    model = MDLGaussianMixture(8).fit(points)
    assert model.mdl(points) == pytest.approx(model.mdl_, rel=1e-12)
    assert model.log_likelihood_ == pytest.approx(model.score_samples(points).sum(), rel=1e-12)


def test_single_precision_finds_the_same_mixture():
    points = blobs(2000).astype(np.float32)
    double, single = (MDLGaussianMixture(8, precision=p).fit(points) for p in ("float64", "float32"))
    assert single.n_components_ == double.n_components_
    assert single.mdl_ == pytest.approx(double.mdl_, abs=1.0)
    assert single.means_.dtype == np.float64


def test_weights_count_points():
    points = blobs(200)
    weights = np.random.default_rng(2).integers(0, 4, len(points))
    weighted = MDLGaussianMixture(max_components=1).fit(points, sample_weight=weights)
    repeated = MDLGaussianMixture(max_components=1).fit(np.repeat(points, weights, axis=0))
    np.testing.assert_allclose(weighted.covariances_, repeated.covariances_, rtol=1e-6)
    assert weighted.mdl_ == pytest.approx(repeated.mdl_, rel=1e-9)


def test_samples_come_from_the_mixture():
    model = MDLGaussianMixture(6).fit(blobs(2000, seed=4))
    points, components = model.sample(20_000)
    assert points.shape == (20_000, 3)
    shares = np.bincount(components, minlength=model.n_components_) / len(components)
    np.testing.assert_allclose(shares, model.weights_, atol=0.015)
    for k, mean in enumerate(model.means_):
        np.testing.assert_allclose(points[components == k].mean(0), mean, atol=0.15)
    np.testing.assert_array_equal(model.sample(5)[0], model.sample(5)[0])
    with pytest.raises(ValueError, match="at least 1"):
        model.sample(0)


def test_what_cannot_be_fitted_is_refused_with_advice():
    points = blobs(50)
    for useless in (np.zeros(50), np.full(50, np.nan)):
        with pytest.raises(ValueError, match="zero everywhere"):
            MDLGaussianMixture().fit(points, sample_weight=useless)
    with pytest.raises(ValueError, match="NaN"):
        MDLGaussianMixture().fit(np.full((4, 2), np.nan))
    with pytest.raises(ValueError, match="weights must be >= 0"):
        MDLGaussianMixture().fit(points, sample_weight=-np.ones(50))
    for wrong in (
        {"precision": "float16"},
        {"initializer": "best"},
        {"criterion": "aic"},
        {"max_components": 0},
    ):
        with pytest.raises(ValueError, match=r"choose one|must be one of|at least 1"):
            MDLGaussianMixture(**wrong).fit(points)


@pytest.mark.parametrize(
    "method", ["predict", "predict_proba", "score_samples", "score", "bic", "aic", "mdl"]
)
def test_nothing_works_before_fit(method):
    with pytest.raises(NotFittedError):
        getattr(MDLGaussianMixture(), method)(blobs(5))
    with pytest.raises(NotFittedError):
        MDLGaussianMixture().sample()
    assert not hasattr(MDLGaussianMixture(), "mixtures_")


def test_warns_when_em_runs_out_of_iterations():
    with pytest.warns(ConvergenceWarning, match="max_iterations"):
        model = MDLGaussianMixture(8, max_iterations=1).fit(room(500))
    assert not model.converged_
    assert model.status_ is Status.NOT_CONVERGED


def test_copies_and_pickles():
    model = MDLGaussianMixture(4, min_std=0.01, random_state=np.random.RandomState(3), initializer="kmeans++")
    assert clone(model).get_params()["min_std"] == 0.01
    assert model.set_params(max_components=3).max_components == 3
    points = blobs(100)
    fitted = model.fit(points)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(fitted)).predict(points), fitted.predict(points))
    np.testing.assert_array_equal(clone(model).fit_predict(points).shape, (100,))


def test_the_engine_does_not_import_scikit_learn():
    code = (
        "import sys, gmmtorch; assert 'sklearn' not in sys.modules; "
        "gmmtorch.MDLGaussianMixture; assert 'sklearn' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    assert "MDLGaussianMixture" in dir(gmmtorch)
    with pytest.raises(AttributeError, match="nothing_of_this_name"):
        gmmtorch.nothing_of_this_name  # noqa: B018


def test_examples_run():
    results = doctest.testmod(gmmtorch.estimator)
    assert results.attempted > 3
    assert results.failed == 0
