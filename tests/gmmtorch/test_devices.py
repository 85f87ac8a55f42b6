"""Ready for accelerators, proven without one: no synchronisation in an iteration, shapes on the meta device."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from gmmtorch import PointClouds, fit_em, fit_mdl
from gmmtorch.components import Components
from gmmtorch.em import EMState, em_step
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


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_cuda_agrees_with_the_cpu(dtype):
    clouds = PointClouds.from_list([room(3000), room(500, 1)], dtype=dtype)
    on_cpu, on_cuda = (
        fit_em(clouds.to(device), 6, max_iterations=10, tolerance=None) for device in ("cpu", "cuda")
    )
    torch.testing.assert_close(on_cuda.mixtures.means.cpu(), on_cpu.mixtures.means, rtol=1e-3, atol=1e-3)
    assert fit_mdl(clouds.to("cuda"), 6).mixtures.means.is_cuda
