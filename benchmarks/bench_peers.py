"""The same work by gmmtorch and by its peers, side by side (`make bench`; `novelty report --benchmarks bench.json`).

Every benchmark names its library in `extra_info`, and those of one group do the same work: the same points, the same
start, the same number of iterations, or the same search.
"""

import warnings

import pytest
import torch

from gmmtorch import PointClouds, fit_em, fit_mdl
from tests.helpers import room

NUM_POINTS, NUM_COMPONENTS, ITERATIONS = 20_000, 20, 50
SEARCHED_POINTS = 5_000

EM = pytest.mark.benchmark(
    group=f"EM: {NUM_POINTS} points, {NUM_COMPONENTS} components, {ITERATIONS} iterations, float64"
)
SEARCH = pytest.mark.benchmark(
    group=f"Order search: {SEARCHED_POINTS} points, from {NUM_COMPONENTS} components to 1"
)


@pytest.fixture(scope="module")
def cloud():
    return room(NUM_POINTS)


@pytest.fixture(scope="module")
def start(cloud):
    clouds = PointClouds.from_list([cloud])
    return fit_em(clouds, NUM_COMPONENTS, max_iterations=0, tolerance=None).mixtures


def timed(benchmark, library, work, rounds=5):
    benchmark.extra_info["library"] = library
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # peers say that they have not converged, as was asked of them
        benchmark.pedantic(work, rounds=rounds, warmup_rounds=1 if rounds > 1 else 0)


@EM
def test_em_gmmtorch(benchmark, cloud, start):
    clouds = PointClouds.from_list([cloud])
    options = {"initial": start, "max_iterations": ITERATIONS, "tolerance": None}
    timed(benchmark, "gmmtorch", lambda: fit_em(clouds, **options))


@EM
def test_em_onedal(benchmark, cloud, start):
    pytest.importorskip("daal4py", reason="the extra [bench] is not installed")
    from benchmarks.engine.peers import OneDal

    timed(benchmark, "oneDAL", OneDal(cloud, start, ITERATIONS, "float64"))


@EM
def test_em_scikit_learn(benchmark, cloud, start):
    from sklearn.mixture import GaussianMixture

    model = GaussianMixture(
        NUM_COMPONENTS,
        max_iter=ITERATIONS,
        tol=0.0,
        weights_init=start.weights[0].numpy(),
        means_init=start.means[0].numpy(),
        precisions_init=torch.linalg.inv(start.covariances[0]).numpy(),
    )
    timed(benchmark, "scikit-learn", lambda: model.fit(cloud), rounds=1)


@SEARCH
def test_search_gmmtorch(benchmark):
    clouds = PointClouds.from_list([room(SEARCHED_POINTS)])
    timed(benchmark, "gmmtorch", lambda: fit_mdl(clouds, NUM_COMPONENTS))


@SEARCH
def test_search_gmcluster(benchmark):
    gmcluster = pytest.importorskip("gmcluster")
    points = room(SEARCHED_POINTS)
    timed(
        benchmark,
        "gmcluster",
        lambda: gmcluster.GMModel.estimate(points, max_clusters=NUM_COMPONENTS, alpha=1e-3),
        rounds=1,
    )


@SEARCH
def test_search_scikit_learn(benchmark):
    from sklearn.mixture import GaussianMixture

    points = room(SEARCHED_POINTS)

    def bic_loop():
        models = [GaussianMixture(k, random_state=0).fit(points) for k in range(1, NUM_COMPONENTS + 1)]
        return min(models, key=lambda model: model.bic(points))

    timed(benchmark, "scikit-learn (BIC loop)", bic_loop, rounds=1)
