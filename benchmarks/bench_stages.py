"""Time of each stage, and of the whole, on one simulated pair (`make bench`, pytest-benchmark)."""

import pytest

import gmmtorch
import novelty
from gmmtorch import PointClouds
from novelty.config import Config, detector_names
from novelty.fitting import FitPlan
from novelty.preprocess import prepare_pairs
from novelty.registration import register
from novelty.scan import ScanPair
from novelty.simulation import corridor_pair
from tests.helpers import room

PAIRS = 4


@pytest.fixture(scope="module")
def pairs() -> list[ScanPair]:
    return [corridor_pair(seed=200 + seed, density=0.3) for seed in range(PAIRS)]


@pytest.fixture(scope="module")
def batch(pairs):
    return prepare_pairs(pairs, Config().preprocess)


def test_simulate(benchmark):
    benchmark.pedantic(corridor_pair, kwargs={"seed": 200, "density": 0.3}, rounds=5, warmup_rounds=1)


def test_preprocess(benchmark, pairs):
    benchmark.pedantic(prepare_pairs, (pairs, Config().preprocess), rounds=5, warmup_rounds=1)


def test_register(benchmark, batch):
    benchmark.pedantic(register, (batch, Config().registration), rounds=5, warmup_rounds=1)


@pytest.mark.parametrize("detector", detector_names())
def test_fit(benchmark, batch, detector):
    plan = FitPlan(settings=Config().fit)
    chosen = Config(detector=detector).chosen_detector
    benchmark.pedantic(chosen.fit, (batch, plan), rounds=3, warmup_rounds=1)


@pytest.mark.parametrize("detector", detector_names())
def test_compare(benchmark, batch, detector):
    chosen = Config(detector=detector).chosen_detector
    models = chosen.fit(batch, FitPlan(settings=Config().fit))
    benchmark.pedantic(chosen.compare, (batch, models), rounds=5, warmup_rounds=1)


def test_detect(benchmark, pairs):
    benchmark.pedantic(novelty.detect, (pairs[0],), rounds=3, warmup_rounds=1)


def test_detect_many(benchmark, pairs):
    benchmark.pedantic(novelty.detect_many, (pairs,), rounds=3, warmup_rounds=1)


@pytest.mark.parametrize("num_points", [10_000, 100_000])
def test_em(benchmark, num_points):
    clouds = PointClouds.from_list([room(num_points)])
    options = {"num_components": 20, "max_iterations": 50, "tolerance": None}
    benchmark.pedantic(gmmtorch.fit_em, (clouds,), options, rounds=3, warmup_rounds=1)


def test_order_search(benchmark):
    clouds = PointClouds.from_list([room(10_000, seed=seed) for seed in range(2)])
    benchmark.pedantic(gmmtorch.fit_mdl, (clouds, 20), rounds=3, warmup_rounds=1)
