"""The same work on a CUDA device and by the compiled loops of this machine's CPU: speed, and how far apart they end."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator

import torch

from benchmarks.engine.timing import Row, alternate
from gmmtorch import EMResult, FitResult, PointClouds, fit_em, fit_mdl
from tests.helpers import room

ITERATIONS = 50
_CLOUDS = 8
"""Rooms made anew; a larger batch repeats them, since making them takes longer than fitting them."""


def cuda_beside_cpu(
    runs: int, sizes: tuple[int, ...], num_clouds: int = 64, device: str = "cuda"
) -> Iterator[object]:
    """EM and order search in both precisions; every time ends with the result on the host."""
    if device == "cuda" and not torch.cuda.is_available():
        yield "no CUDA device: the comparison of devices is left out"
        return
    if device == "cuda":
        yield f"{torch.cuda.get_device_name()}, CUDA {torch.version.cuda}; ours: CUDA, peer: the CPU"
    for dtype in (torch.float32, torch.float64):
        for count, size in [*((1, n) for n in sizes), (num_clouds, sizes[0])]:
            yield _em(count, size, dtype, device, runs)
    for dtype in (torch.float32, torch.float64):
        for count in (1, num_clouds):
            yield _order(count, sizes[0], dtype, device, runs)


def _em(count: int, size: int, dtype: torch.dtype, device: str, runs: int) -> Row:
    clouds = _rooms(count, size, dtype)
    start = fit_em(clouds, 20, max_iterations=0, tolerance=None).mixtures

    def call(on: str) -> EMResult:
        return fit_em(clouds.to(on), initial=start.to(on), max_iterations=ITERATIONS, tolerance=None)

    times, (ours, theirs) = _both(call, device, runs)
    apart = ((ours.log_likelihood.cpu() - theirs.log_likelihood).abs() / size).max()
    per_unit = 1e9 * times[0] / (count * size * 20 * ITERATIONS)
    remark = f"{per_unit:.3f} ns per point, component, iteration; {float(apart):.1e} nats per point apart"
    return Row(_named("EM", count, size, dtype), *_sides(times), remark)


def _order(count: int, size: int, dtype: torch.dtype, device: str, runs: int) -> Row:
    clouds = _rooms(count, size, dtype)

    def call(on: str) -> FitResult:
        return fit_mdl(clouds.to(on), 20)

    times, (ours, theirs) = _both(call, device, runs)
    lengths = [float(result.mdl.mean()) for result in (ours, theirs)]
    remark = f"mean MDL {lengths[0]:.0f} against {lengths[1]:.0f}"
    return Row(_named("order search", count, size, dtype), *_sides(times), remark)


def _both(
    call: Callable[[str], EMResult | FitResult], device: str, runs: int
) -> tuple[tuple[float, float], list[EMResult | FitResult]]:
    """Median times on the device and on the CPU, and what came out; reading the order waits for the device."""
    reached: dict[str, EMResult | FitResult] = {}

    def on(where: str) -> None:
        reached[where] = call(where)
        reached[where].mixtures.num_components.tolist()

    times = alternate(functools.partial(on, device), functools.partial(on, "cpu"), runs)
    return times, [reached[device], reached["cpu"]]


def _rooms(count: int, size: int, dtype: torch.dtype) -> PointClouds:
    made = [room(size, seed) for seed in range(min(count, _CLOUDS))]
    return PointClouds.from_list([made[b % len(made)] for b in range(count)], dtype=dtype)


def _named(what: str, count: int, size: int, dtype: torch.dtype) -> str:
    return f"{what}, {count} x {size} points, K = 20, {str(dtype).removeprefix('torch.')}"


def _sides(times: tuple[float, float]) -> tuple[float, str, float]:
    return times[0], f"CPU, {torch.get_num_threads()} threads", times[1]
