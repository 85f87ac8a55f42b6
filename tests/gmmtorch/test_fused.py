"""The compiled pass over the points against the tensor operations that it stands for."""

import pytest
import torch

from gmmtorch import PointClouds, fit_em, fused, statistics
from gmmtorch.em import EMState, em_step
from gmmtorch.problem import initial_components, prepare
from tests.helpers import blobs, room


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


@pytest.mark.parametrize("threads", [2, 3])
def test_every_tile_is_passed_once(monkeypatch, threads):
    work, components = fitted([room(3000)], torch.float64)
    shares = []
    monkeypatch.setattr(fused, "_run", lambda first, last, *_: shares.append((first, last)))
    monkeypatch.setattr(fused, "_SPLIT_ABOVE", 0)
    monkeypatch.setattr(torch, "get_num_threads", lambda: threads)
    fused._pool.cache_clear()
    statistics.expectation(work.tiles, components, work.floor)
    fused._pool.cache_clear()
    assert [g for first, last in sorted(shares) for g in range(first, last)] == list(
        range(len(work.tiles.owner))
    )
    assert len(shares) == threads
