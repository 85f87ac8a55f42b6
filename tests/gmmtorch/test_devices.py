"""Ready for accelerators, proven without one: no synchronisation in an iteration, shapes on the meta device."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from gmmtorch import (
    GROUND_DISTANCES,
    INITIALIZERS,
    MixtureModel,
    PointClouds,
    emd,
    fit_em,
    fit_mdl,
    greedy_removals,
    ground_distance,
    unbalanced_emd,
    update,
)
from gmmtorch.components import Components
from gmmtorch.em import EMState, em_step
from gmmtorch.graphs import Stepper
from gmmtorch.merging import merge_by_tensor_operations
from gmmtorch.problem import Workload, initial_components, prepare
from gmmtorch.statistics import expectation, log_likelihood
from gmmtorch.tiles import Storage, Tiles
from tests.helpers import room

SYNCHRONISING = {
    "aten::_local_scalar_dense",
    "aten::item",
    "aten::nonzero",
    "aten::masked_select",
    "aten::is_nonzero",
    "aten::equal",
    "aten::_unique2",
    "aten::unique_dim",
    "aten::unique_consecutive",
    "aten::_to_cpu",
}


class NoSynchronisation(TorchDispatchMode):
    """Fails on every call that would make the host wait for a device."""

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        name = func._schema.name
        assert name not in SYNCHRONISING, f"{name} synchronises the device"
        if name in {"aten::index", "aten::index_put", "aten::index_put_"}:
            indices = [i for i in args[1] if i is not None]
            assert all(i.dtype != torch.bool for i in indices), "a boolean mask synchronises the device"
        if name == "aten::repeat_interleave":
            assert (kwargs or {}).get("output_size") is not None, (
                "repeat_interleave without a size synchronises"
            )
        return func(*args, **(kwargs or {}))


def prepared(dtype=torch.float64, device="cpu", accelerate=False):
    clouds = PointClouds.from_list([room(1500), room(300, 1)], dtype=dtype, device=device)
    problem = prepare(clouds, None, 1e-4, "model", "mdl", accelerate)
    return problem, initial_components(problem, [6, 4], "evenly_spaced", 0, 0)


@pytest.mark.parametrize(
    "call", [lambda x: x.sum().item(), lambda x: x[x > 0], lambda x: bool((x > 0).any()), torch.nonzero]
)
def test_the_guard_catches_what_it_should(call):
    with pytest.raises(AssertionError, match="synchronises"), NoSynchronisation():
        call(torch.ones(3))


@pytest.mark.parametrize("accelerate", [False, True])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_an_iteration_does_not_synchronise(monkeypatch, dtype, accelerate):
    monkeypatch.setattr(Tiles, "on_cpu", False)  # the tensor operations, which a device takes
    problem, components = prepared(dtype, accelerate=accelerate)
    work = problem.workload
    statistics = expectation(work.tiles, components, work.floor)
    state = replace(EMState.start(components), objective=statistics.objective)
    with NoSynchronisation():
        for _ in range(3):
            state, statistics = em_step(work, state, statistics)
        log_likelihood(work.tiles, state.components)
        total = problem.normalized.clouds.total_weights
        merge_by_tensor_operations(state.components, total, state.converged).compact(5)
    assert (state.num_iterations == 3).all()


@pytest.mark.parametrize(("num_tiles", "num_components", "dim"), [(7, 4, 3), (2, 1, 1), (3, 20, 10)])
@pytest.mark.parametrize("relaxation", [1.0, 1.5])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_shapes_on_the_meta_device(num_tiles, num_components, dim, dtype, relaxation):
    counts = (num_tiles - 1, 1)

    def meta(*shape, dtype=torch.float64):
        return torch.empty(*shape, dtype=dtype, device="meta")

    storage = Storage(
        meta(num_tiles, dim, 128), None, meta(num_tiles, 1, 128), meta(num_tiles, dim), dtype
    )  # fmt: skip
    tiles = Tiles(storage, (0, counts[0]), counts)
    work = Workload(tiles, *(meta(2) for _ in range(6)), relaxation=relaxation)
    components = Components(
        meta(2, num_components), meta(2, num_components, dim),
        meta(2, num_components, dim, dim), meta(2, num_components, dim, dim),
    )  # fmt: skip
    statistics = expectation(tiles, components, work.floor)
    assert statistics.counts.shape == (2, num_components)
    assert statistics.second.shape == (2, num_components, dim, dim)
    assert statistics.objective.dtype == torch.float64
    state, statistics = em_step(work, EMState.start(components), statistics)
    assert state.components.covariances.shape == (2, num_components, dim, dim)
    assert state.components.means.device.type == "meta"


needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")


@pytest.fixture
def no_waiting():
    """Makes CUDA itself fail on every call that waits for it."""
    yield lambda: torch.cuda.set_sync_debug_mode("error")
    torch.cuda.set_sync_debug_mode("default")


def rooms(device="cpu", dtype=torch.float64):
    return PointClouds.from_list([room(3000), room(500, 1), room(40, 2)], dtype=dtype).to(device)


def close(on_cuda, on_cpu, tolerance=1e-6):
    assert on_cuda.is_cuda
    torch.testing.assert_close(on_cuda.cpu(), on_cpu, rtol=tolerance, atol=tolerance, equal_nan=True)


@needs_cuda
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("accelerate", [False, True])
def test_cuda_fits_what_the_cpu_fits(dtype, accelerate):
    options = {"max_iterations": 10, "tolerance": None, "accelerate": accelerate}
    on_cpu, on_cuda = (fit_em(rooms(device, dtype), 6, **options) for device in ("cpu", "cuda"))
    tolerance = 1e-8 if dtype == torch.float64 else 2e-3
    for name in ("weights", "means", "covariances"):
        close(getattr(on_cuda.mixtures, name), getattr(on_cpu.mixtures, name), tolerance)
    close(on_cuda.log_likelihood / 3000, on_cpu.log_likelihood / 3000, tolerance)


@needs_cuda
@pytest.mark.parametrize("initializer", [name for name in INITIALIZERS if name != "from_mixtures"])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_cuda_searches_the_order_as_the_cpu_does(dtype, initializer):
    on_cpu, on_cuda = (
        fit_mdl(rooms(device, dtype), 6, initializer=initializer, return_path=True)
        for device in ("cpu", "cuda")
    )
    assert on_cuda.status.cpu().tolist() == on_cpu.status.tolist()
    # Other round-off may end in another optimum: the description is as short to a fiftieth of a nat per point.
    sizes = torch.tensor([3000.0, 500.0, 40.0])
    assert ((on_cuda.mdl.cpu() - on_cpu.mdl).abs() / sizes < 0.02).all()


@needs_cuda
@pytest.mark.parametrize("accelerate", [False, True])
def test_no_iteration_waits_for_cuda(no_waiting, accelerate):
    problem, components = prepared(torch.float32, "cuda", accelerate)
    work = problem.workload
    statistics = expectation(work.tiles, components, work.floor)
    state = replace(EMState.start(components), objective=statistics.objective)
    em_step(work, state, statistics)  # handles of the libraries are made
    no_waiting()
    for _ in range(3):
        state, statistics = em_step(work, state, statistics)
    merge_by_tensor_operations(state.components, problem.normalized.clouds.total_weights, state.converged)
    torch.cuda.set_sync_debug_mode("default")
    assert state.num_iterations.tolist() == [3, 3]


def test_a_stepper_on_the_cpu_calls_the_step():
    state = Components.create(torch.ones(1, 1), torch.zeros(1, 1, 3), torch.eye(3)[None, None])
    calls = []
    step = Stepper(lambda state, statistics: (calls.append(state), (state, statistics))[1])
    for _ in range(3):
        assert step(state, state) == (state, state)
    assert len(calls) == 3


@needs_cuda
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_a_graph_iterates_as_single_launches_do(dtype):
    problem, components = prepared(dtype, "cuda", accelerate=True)
    work = problem.workload
    statistics = expectation(work.tiles, components, work.floor)
    state = replace(EMState.start(components), objective=statistics.objective)
    step = Stepper(lambda state, statistics: em_step(work, state, statistics))
    plain = graphed = (state, statistics)
    for _ in range(6):
        plain, graphed = em_step(work, *plain), step(*graphed)
    torch.testing.assert_close(graphed[0].components.means, plain[0].components.means, rtol=0, atol=0)
    torch.testing.assert_close(graphed[1].counts, plain[1].counts, rtol=0, atol=0)
    again = step(state, statistics)  # from the start, in the memory of the graph
    torch.testing.assert_close(again[0].objective, em_step(work, state, statistics)[0].objective)


@needs_cuda
def test_a_step_that_no_graph_can_hold_is_said():
    ones = torch.ones(1, 1, device="cuda")
    state = Components.create(
        ones, torch.zeros(1, 1, 3, device="cuda"), torch.eye(3, device="cuda")[None, None]
    )
    calls = []
    step = Stepper(
        lambda state, statistics: (calls.append(state.weights.sum().item()), (state, statistics))[1]
    )
    step(state, state)
    with pytest.warns(RuntimeWarning, match="kernel by kernel"):
        step(state, state)
    step(state, state)
    assert calls == [1.0, 1.0, 1.0]


@needs_cuda
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_a_cloud_on_cuda_is_fitted_alike_in_any_company(dtype):
    clouds = rooms("cuda", dtype)
    together = fit_em(clouds, 5, max_iterations=10, tolerance=None).mixtures
    for b in range(3):
        alone = fit_em(clouds.select([b]), 5, max_iterations=10, tolerance=None).mixtures
        tolerance = 1e-9 if dtype == torch.float64 else 1e-4
        close(alone.means, together.means[b : b + 1].cpu(), tolerance)


@needs_cuda
def test_mixtures_answer_on_cuda_as_on_the_cpu():
    mixtures = fit_mdl(rooms(), 6).mixtures
    there = mixtures.to("cuda")
    close(there.log_prob(rooms("cuda")), mixtures.log_prob(rooms()))
    close(there.responsibilities(rooms("cuda")), mixtures.responsibilities(rooms()))
    close(there.assign(rooms("cuda")), mixtures.assign(rooms()))
    shapes, there_shapes = ((m.means, m.covariances) * 2 for m in (mixtures, there))
    for name in GROUND_DISTANCES:
        close(ground_distance(name, *there_shapes), ground_distance(name, *shapes), 1e-5)
    cost, weights = ground_distance("hellinger", *shapes), mixtures.weights
    reversed_ = weights.flip(1)
    close(emd(weights.cuda(), reversed_.cuda(), cost.cuda()).distance, emd(weights, reversed_, cost).distance)
    left = unbalanced_emd(weights.cuda(), reversed_.cuda(), cost.cuda(), 0.3)
    close(left.unmatched_a, unbalanced_emd(weights, reversed_, cost, 0.3).unmatched_a)
    removed = greedy_removals(weights.cuda(), reversed_.cuda(), cost.cuda())
    assert torch.equal(removed.removed.cpu(), greedy_removals(weights, reversed_, cost).removed)


@needs_cuda
@pytest.mark.parametrize("options", [{"coarse": 8}, {"coarse": 8, "coarse_by": "cells"}, {"n_init": 2}])
def test_options_of_the_order_search_work_on_cuda(options):
    if options.get("n_init"):
        options = options | {"initializer": "random_points"}
    on_cpu, on_cuda = (fit_mdl(rooms(device), 6, **options) for device in ("cpu", "cuda"))
    assert on_cuda.mixtures.means.is_cuda
    assert ((on_cuda.mdl.cpu() - on_cpu.mdl).abs() / torch.tensor([3000.0, 500.0, 40.0]) < 0.02).all()


@needs_cuda
def test_a_map_is_updated_on_cuda(tmp_path):
    models = []
    for device in ("cpu", "cuda"):
        known = MixtureModel.of(fit_mdl(rooms(device), 6).mixtures, rooms(device))
        models.append(update(known, rooms(device), max_components=6).model)
    on_cpu, on_cuda = models
    close(on_cuda.total_weights, on_cpu.total_weights)
    on_cuda.save(tmp_path / "map.safetensors")
    kept = MixtureModel.load(tmp_path / "map.safetensors")
    torch.testing.assert_close(kept.mixtures.means, on_cuda.mixtures.means.cpu())
