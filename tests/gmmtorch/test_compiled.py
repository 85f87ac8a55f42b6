"""The compiled loops against the tensor operations that they stand for."""

import numpy as np
import pytest
import torch

from gmmtorch import GaussianMixtures, PointClouds, evaluation, fit_em, statistics
from gmmtorch.compiled import batch, threads
from gmmtorch.em import EMState, em_step, run_em
from gmmtorch.problem import initial_components, prepare
from gmmtorch.tiles import Storage
from tests.helpers import blobs, mixture_parameters, room


def fitted(points, dtype, spreads=None, iterations=4):
    """A workload, and components after a few iterations."""
    clouds = PointClouds.from_list(points, spreads=spreads, dtype=dtype)
    problem = prepare(clouds, None, 1e-4, "model", None)
    work = problem.workload
    state = EMState.start(initial_components(problem, [6] * len(points), "evenly_spaced", 0, 0))
    seen = statistics.expectation(work.tiles, state.components, work.floor)
    for _ in range(iterations):
        state, seen = em_step(work, state, seen)
    return work, state.components


def both(monkeypatch, call):
    compiled = call()
    monkeypatch.setattr(statistics.Tiles, "on_cpu", False)
    return compiled, call()


@pytest.mark.parametrize("dim", [1, 2, 3, 5, 10])
@pytest.mark.parametrize("cells", [False, True])
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-9), (torch.float32, 1e-3)])
def test_agrees_with_tensor_operations(monkeypatch, dim, cells, dtype, tolerance):
    points = [blobs(700, dim, seed=1), blobs(400, dim, seed=2)]
    spreads = [torch.eye(dim).expand(len(x), dim, dim).numpy() * 0.01 for x in points] if cells else None
    work, components = fitted(points, dtype, spreads)
    first, second = both(monkeypatch, lambda: statistics.expectation(work.tiles, components, work.floor))
    for name in ("counts", "first", "second", "objective", "log_likelihood"):
        torch.testing.assert_close(
            getattr(first, name), getattr(second, name), rtol=tolerance, atol=tolerance * 100
        )


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_values_agree_in_float64_whatever_the_precision(monkeypatch, dtype):
    work, components = fitted([room(3000), room(400, 1)], dtype)
    first, second = both(monkeypatch, lambda: statistics.log_likelihood(work.tiles, components))
    torch.testing.assert_close(first, second, rtol=1e-12, atol=1e-8)


def test_leaving_components_out_loses_nothing(monkeypatch):
    """Thin walls: most components are 60 nats below the largest in most blocks."""
    work, components = fitted([room(20_000)], torch.float64, iterations=30)
    first, second = both(monkeypatch, lambda: statistics.expectation(work.tiles, components, work.floor))
    torch.testing.assert_close(first.counts, second.counts, rtol=1e-11, atol=1e-8)
    torch.testing.assert_close(first.objective, second.objective, rtol=1e-13, atol=1e-8)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_threads_change_no_bit(dtype):
    clouds = PointClouds.from_list([room(60_000)], dtype=dtype)
    work = prepare(clouds, None, 1e-4, "model", None).workload
    components = fitted([room(60_000)], dtype, iterations=2)[1]
    before = torch.get_num_threads()
    seen = []
    try:
        for threads in (1, 2, 3):
            torch.set_num_threads(threads)
            seen.append(statistics.expectation(work.tiles, components, work.floor))
    finally:
        torch.set_num_threads(before)
    for other in seen[1:]:
        assert torch.equal(seen[0].second, other.second)
        assert torch.equal(seen[0].objective, other.objective)


def test_weights_too_small_for_float32_are_no_end_of_the_cloud():
    points = room(1000)
    weights = torch.ones(1000, dtype=torch.float64)
    weights[::2] = 1e-60
    result = fit_em(PointClouds.from_list([points], [weights.numpy()], dtype=torch.float32), 4)
    assert float(result.mixtures.weights.sum()) == pytest.approx(1.0)
    assert torch.isfinite(result.log_likelihood).all()


@pytest.mark.parametrize("number", [2, 3])
def test_every_unit_is_passed_once(monkeypatch, number):
    work, components = fitted([room(9000), room(5000, 1)], torch.float64)
    shares = []
    monkeypatch.setattr(batch, "pass_over_points", lambda units, *cut: shares.append(units[slice(*cut[:2])]))
    monkeypatch.setattr(threads, "_SPLIT_ABOVE", 0)
    monkeypatch.setattr(torch, "get_num_threads", lambda: number)
    threads._pool.cache_clear()
    statistics.expectation(work.tiles, components, work.floor)
    threads._pool.cache_clear()
    owners, starts, stops, _ = work.tiles.units
    assert sorted(u for share in shares for u in share.tolist()) == list(range(len(owners)))
    assert len(shares) == number
    passed = [g for start, stop in zip(starts, stops, strict=True) for g in range(start, stop)]
    assert sorted(passed) == list(range(len(work.tiles.owner)))


@pytest.mark.parametrize("accelerate", [False, True])
@pytest.mark.parametrize("dim", [1, 3, 4])
@pytest.mark.parametrize("cells", [False, True])
def test_iterations_are_those_of_the_tensor_operations(monkeypatch, accelerate, dim, cells):
    """Step by step: the same mixtures, gains, step lengths and stops."""
    points = [blobs(700, dim, seed=1), blobs(400, dim, seed=2), blobs(20, dim, seed=3)]
    spreads = [torch.eye(dim).expand(len(x), dim, dim).numpy() * 0.01 for x in points] if cells else None
    clouds = PointClouds.from_list(points, spreads=spreads)
    problem = prepare(clouds, None, 1e-4, "model", "mdl", accelerate)
    start = initial_components(problem, [6, 4, 6], "evenly_spaced", 0, 0)
    for iterations in (0, 1, 2, 7, 60):
        ours, theirs = both(monkeypatch, lambda n=iterations: run_em(problem.workload, start, n))
        monkeypatch.undo()
        assert torch.equal(ours.num_iterations, theirs.num_iterations)
        assert torch.equal(ours.converged, theirs.converged)
        assert torch.equal(ours.step, theirs.step)
        for name in ("objective", "log_likelihood", "gain"):
            torch.testing.assert_close(getattr(ours, name), getattr(theirs, name), rtol=1e-9, atol=1e-5)
        for name in ("weights", "means", "covariances", "factors"):
            torch.testing.assert_close(
                getattr(ours.components, name), getattr(theirs.components, name), rtol=1e-6, atol=1e-8
            )


def test_a_component_without_points_is_dropped_and_the_others_share_its_weight(monkeypatch):
    problem = prepare(PointClouds.from_list([blobs(300)]), None, 1e-4, "model", None)
    start = initial_components(problem, [3], "evenly_spaced", 0, 0)
    far = start.means.clone()
    far[0, 1] = 1e6
    start = type(start).create(start.weights, far, start.covariances)
    ours, theirs = both(monkeypatch, lambda: run_em(problem.workload, start, 3))
    assert ours.components.weights[0, 1] == theirs.components.weights[0, 1] == 0
    torch.testing.assert_close(ours.components.weights, theirs.components.weights)


@pytest.mark.parametrize("dim", [1, 2, 3, 6])
def test_ellipsoids_hold_their_points(dim):
    generator = torch.Generator().manual_seed(dim)
    local = torch.randn(5, dim, 128, generator=generator, dtype=torch.float64)
    local[1, 0] *= 1e-9  # flat
    local[2] = 0.0  # one point
    local[3, :, 40:] = 0.0  # padding
    weights = torch.ones(5, 1, 128, dtype=torch.float64)
    weights[3, 0, 40:] = 0.0
    rows, columns = torch.triu_indices(dim, dim)
    matrices = torch.zeros(5, dim, dim, dtype=torch.float64)
    storage = Storage(local, None, weights, torch.zeros(5, dim).double(), torch.float64)
    matrices[:, rows, columns] = storage.reach
    matrices[:, columns, rows] = matrices[:, rows, columns]
    assert (matrices[2] == 0).all()
    for g in (0, 1, 3, 4):
        scaled = local[g] * torch.linalg.inv(matrices[g]).matmul(local[g])
        assert float(scaled.sum(0).max()) == pytest.approx(1.0, abs=3e-6)
        assert float(scaled.sum(0).max()) <= 1.0


@pytest.mark.parametrize("dim", [1, 3, 5])
@pytest.mark.parametrize("cells", [False, True])
def test_evaluation_agrees_with_tensor_operations(monkeypatch, dim, cells):
    points = [blobs(300, dim, seed=1), blobs(0, dim), blobs(150, dim, seed=2) + 5e5]
    spreads = [0.05 * np.eye(dim)[None].repeat(len(x), 0) for x in points] if cells else None
    clouds = PointClouds.from_list(points, [np.arange(len(x)) for x in points], spreads)
    given = [mixture_parameters(k, dim, seed=k) for k in (5, 2, 3)]
    given[2] = (given[2][0], given[2][1] + 5e5, 1e-4 * given[2][2])
    mixtures = GaussianMixtures.from_list([GaussianMixtures.from_arrays(*g) for g in given])

    def everything():
        posterior = mixtures.posterior(clouds)
        alone = (mixtures.log_prob(clouds), mixtures.responsibilities(clouds), mixtures.assign(clouds))
        return (
            posterior.log_prob,
            posterior.responsibilities,
            posterior.components,
            *alone,
            mixtures.expected_counts(clouds),
        )

    ours = everything()
    monkeypatch.setattr(evaluation, "_on_cpu", lambda clouds: False)
    for one, other in zip(ours, everything(), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9)


def test_what_is_not_finite_has_no_density_and_spoils_no_neighbour():
    mixtures = GaussianMixtures.from_arrays(*mixture_parameters(3, 3))
    points = blobs(20)
    spoilt = points.copy()
    spoilt[0, 1], spoilt[7, 2] = np.nan, np.inf
    alone, beside = (mixtures.posterior(PointClouds.from_list([x])) for x in (points, spoilt))
    bad = torch.zeros(20, dtype=torch.bool)
    bad[[0, 7]] = True
    assert beside.log_prob[bad].isnan().all()
    assert beside.responsibilities[bad].isnan().all()
    assert beside.components[bad].tolist() == [-1, -1]
    torch.testing.assert_close(beside.log_prob[~bad], alone.log_prob[~bad])
    assert torch.equal(beside.components[~bad], alone.components[~bad])
