"""EM at a fixed order: one cloud, a batch of equal ones, a ragged batch, and what compiling costs."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

import numpy as np
import torch

from benchmarks.engine.peers import OneDal, gmm_gpu_em, scikit_learn_em
from benchmarks.engine.timing import Row, alternate
from gmmtorch import EMResult, GaussianMixtures, PointClouds, fit_em
from tests.helpers import room

ITERATIONS = 50


def one_cloud(runs: int, sizes: tuple[int, ...]) -> Iterator[Row]:
    """K = 20 from one start, beside oneDAL; scikit-learn and gmm-gpu once."""
    for n in sizes:
        points = room(n)
        start = fit_em(PointClouds.from_list([points]), 20, max_iterations=0, tolerance=None).mixtures
        for dtype in (torch.float32, torch.float64):
            yield _beside_onedal(points, start, dtype, runs)
        ours = _median_of(points, start)
        once = {"scikit-learn": scikit_learn_em, "gmm-gpu, float32": gmm_gpu_em}
        for peer, em in once.items():
            seconds = em(points, start, ITERATIONS)
            if seconds is not None:
                yield Row("  the same in float64, one run of the peer", ours, peer, seconds)


def _beside_onedal(points: np.ndarray, start: GaussianMixtures, dtype: torch.dtype, runs: int) -> Row:
    name, n = str(dtype).removeprefix("torch."), len(points)
    clouds = PointClouds.from_list([points], dtype=dtype)
    theirs = OneDal(points, start, ITERATIONS, name)
    reached: list[EMResult] = []
    times = alternate(lambda: reached.append(_ours(clouds, start)), theirs, runs)
    apart = (float(reached[-1].log_likelihood) - theirs.log_likelihood()) / n if theirs.fitted else np.nan
    per_unit = 1e9 * times[0] / (n * 20 * ITERATIONS)
    return Row(
        f"EM, N = {n}, K = 20, {ITERATIONS} iterations, {name}", times[0], "oneDAL em_gmm", times[1],
        f"{per_unit:.2f} ns per point, component, iteration; log-likelihoods {apart:+.1e} nats per point apart",
    )  # fmt: skip


def _ours(clouds: PointClouds, start: GaussianMixtures) -> EMResult:
    return fit_em(clouds, initial=start, max_iterations=ITERATIONS, tolerance=None, relative_floor=0.0)


def _median_of(points: np.ndarray, start: GaussianMixtures) -> float:
    clouds = PointClouds.from_list([points])
    return alternate(lambda: _ours(clouds, start), lambda: None, 3)[0]


def batches(runs: int, num_clouds: int = 32, num_ragged: int = 200) -> Iterator[Row]:
    """Many clouds at once, against a loop of oneDAL; ragged ones against as many points in equal ones."""
    points = [room(10_000, seed) for seed in range(num_clouds)]
    clouds = PointClouds.from_list(points)
    start = fit_em(clouds, 16, max_iterations=0, tolerance=None).mixtures
    loop = [OneDal(x, start[b], ITERATIONS, "float64") for b, x in enumerate(points)]
    times = alternate(lambda: _ours(clouds, start), lambda: [call() for call in loop], runs)
    failed = sum(call.failed > 0 for call in loop)
    yield Row(
        f"EM, {num_clouds} x 10000 points, K = 16, {ITERATIONS} iterations, float64", times[0], "loop of oneDAL",
        times[1], f"which raised on {failed} clouds" if failed else "",
    )  # fmt: skip
    sizes = np.random.default_rng(0).integers(500, 60_000, num_ragged)
    ragged = PointClouds.from_list([room(int(n), 1) for n in sizes])
    equal = PointClouds.from_list([room(int(sizes.mean()), 1)] * len(sizes))
    times = alternate(
        lambda: fit_em(ragged, 16, max_iterations=10, tolerance=None),
        lambda: fit_em(equal, 16, max_iterations=10, tolerance=None),
        runs,
    )
    yield Row(
        f"EM, {num_ragged} ragged clouds of 500 to 60000 points", times[0], "equal sizes, same sum", times[1]
    )


def first_use() -> Iterator[str]:
    """What a fresh process spends on the compiled loops, with an empty cache and with a full one."""
    script = (
        "import time, numpy as np, torch; from gmmtorch import PointClouds, fit_mdl\n"
        "c = PointClouds.from_list([np.random.default_rng(0).normal(size=(500, 3))], dtype=getattr(torch, '{}'))\n"
        "a = time.perf_counter(); fit_mdl(c, 3).mixtures.log_prob(c); print(time.perf_counter() - a)"
    )
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        for dtype in ("float64", "float32"):
            seconds = [
                float(subprocess.run([sys.executable, "-c", script.format(dtype)], capture_output=True, text=True,
                                     check=True, env=environment).stdout)
                for _ in range(2)
            ]  # fmt: skip
            yield f"first fit of a process, {dtype}: {seconds[0]:.1f} s to compile, {seconds[1]:.1f} s from the cache"
