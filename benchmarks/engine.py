"""`python -m benchmarks.engine`: the engine against its peers, timed side by side in the same run.

One table: what is measured, our time, the peer's, the ratio. Times are medians of alternating runs (ours, peer, ours,
peer, ...), preparation of the inputs outside the clock, one warm-up first. The clouds are the tests' rooms.
"""

from __future__ import annotations

import argparse
import platform
import resource
import statistics
import subprocess
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

import gmmtorch
from benchmarks.engine_precision import precision
from gmmtorch import GaussianMixtures, PointClouds, description_length, fit_em, fit_mdl, greedy_removals
from tests.gmmtorch.test_removals import changed_rooms
from tests.helpers import room
from tests.reference import transport as plain

DTYPES = {"float32": torch.float32, "float64": torch.float64}


@dataclass(frozen=True)
class Row:
    """One line of the table: what, our median and the peer's (s), and a remark on the quality of the results."""

    what: str
    ours: float
    peer: str
    theirs: float
    remark: str = ""

    def __str__(self) -> str:
        ratio = self.ours / self.theirs
        return f"{self.what:<58} {self.ours:9.3f} {self.theirs:9.3f}  {ratio:6.3f}  {self.peer:<22} {self.remark}"


def alternate(ours: Callable[[], object], peer: Callable[[], object], runs: int) -> tuple[float, float]:
    """Median times of two calls that take turns, after one warm-up each (s)."""
    times: tuple[list[float], list[float]] = ([], [])
    for run in range(runs + 1):
        for call, kept in zip((ours, peer), times, strict=True):
            start = time.perf_counter()
            call()
            if run:
                kept.append(time.perf_counter() - start)
    return statistics.median(times[0]), statistics.median(times[1])


def onedal_em(
    points: np.ndarray, start: GaussianMixtures, iterations: int, dtype: str
) -> Callable[[], object]:
    """EM of oneDAL from the same start."""
    import daal4py

    count = int(start.num_components[0])
    values = np.ascontiguousarray(points, dtype=dtype)
    weights = start.weights[:1, :count].numpy().astype(dtype)
    means = start.means[0, :count].numpy().astype(dtype)
    covariances = [c.astype(dtype) for c in start.covariances[0, :count].numpy()]
    algorithm = daal4py.em_gmm(
        nComponents=count, maxIterations=iterations, accuracyThreshold=0.0, covarianceStorage="full",
        regularizationFactor=0.0, fptype="double" if dtype == "float64" else "float",
    )  # fmt: skip
    return lambda: algorithm.compute(values, weights, means, covariances)


def fixed_order(runs: int, sizes: tuple[int, ...]) -> Iterator[Row]:
    """K = 20, 50 iterations from one start."""
    for n in sizes:
        points = room(n)
        start = fit_em(PointClouds.from_list([points]), 20, max_iterations=0, tolerance=None).mixtures
        for name, dtype in DTYPES.items():
            clouds = PointClouds.from_list([points], dtype=dtype)

            def ours(clouds: PointClouds = clouds, start: GaussianMixtures = start) -> gmmtorch.EMResult:
                return fit_em(clouds, initial=start, max_iterations=50, tolerance=None, relative_floor=0.0)

            theirs = onedal_em(points, start, 50, name)
            times = alternate(ours, theirs, runs)
            per_unit = 1e9 * times[0] / (n * 20 * 50)
            yield Row(f"EM, N = {n}, K = 20, 50 iterations, {name}", times[0], "oneDAL em_gmm", times[1],
                      f"{per_unit:.2f} ns per point, component, iteration")  # fmt: skip
        yield Row(
            "  the same, one run of scikit-learn", times[0], "scikit-learn", scikit_learn_em(points, start)
        )


def scikit_learn_em(points: np.ndarray, start: GaussianMixtures) -> float:
    """Seconds that scikit-learn takes for the same 50 iterations, once."""
    from sklearn.mixture import GaussianMixture

    model = GaussianMixture(
        20, max_iter=50, tol=0.0, reg_covar=0.0, weights_init=start.weights[0].numpy(),
        means_init=start.means[0].numpy(), precisions_init=torch.linalg.inv(start.covariances[0]).numpy(),
    )  # fmt: skip
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(points)
    return time.perf_counter() - begin


def order_search(n: int, num_clouds: int) -> Iterator[Row]:
    """Ten clouds in one call, against gmcluster and a BIC loop of scikit-learn, one run each."""
    from gmcluster import GMModel
    from sklearn.mixture import GaussianMixture

    points = [room(n, seed) for seed in range(num_clouds)]
    clouds = PointClouds.from_list(points)
    best = fit_mdl(clouds, 20)
    ours = statistics.median(timed(lambda: fit_mdl(clouds, 20)) for _ in range(5))
    models: list[GMModel] = []
    theirs = timed(lambda: models.extend(GMModel.estimate(x, max_clusters=20, alpha=1e-3) for x in points))
    reached = float(description_length(as_mixtures(models), clouds).mean())
    remark = f"mean MDL {float(best.mdl.mean()):.0f} against {reached:.0f}"
    yield Row(f"order search, {num_clouds} x {n} points, K_max = 20", ours, "gmcluster", theirs, remark)
    chosen: list[GaussianMixture] = []

    def bic_loop() -> None:
        for x in points[:2]:
            fits = [GaussianMixture(k, random_state=0).fit(x) for k in range(1, 21)]
            chosen.append(min(fits, key=lambda model: model.bic(x)))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        seconds = timed(bic_loop) / 2 * num_clouds
    theirs_mdl = [
        float(
            description_length(GaussianMixtures.from_arrays(m.weights_, m.means_, m.covariances_), clouds[b])[
                0
            ]
        )
        for b, m in enumerate(chosen)
    ]
    remark = (
        f"MDL of two {float(best.mdl[:2].mean()):.0f} against {np.mean(theirs_mdl):.0f}; time scaled from two"
    )
    yield Row("  the same", ours, "scikit-learn BIC loop", seconds, remark)


def batches(runs: int) -> Iterator[Row]:
    """Many clouds at once, against a loop; ragged against equal sizes; several K_max of one scan."""
    points = [room(10_000, seed) for seed in range(32)]
    clouds = PointClouds.from_list(points)
    start = fit_em(clouds, 16, max_iterations=0, tolerance=None).mixtures
    loop = [onedal_em(x, start[b], 50, "float64") for b, x in enumerate(points)]
    times = alternate(
        lambda: fit_em(clouds, initial=start, max_iterations=50, tolerance=None, relative_floor=0.0),
        lambda: [call() for call in loop],
        runs,
    )
    yield Row("EM, 32 x 10000 points, K = 16, 50 iterations, float64", times[0], "loop of oneDAL", times[1])
    sizes = np.random.default_rng(0).integers(500, 60_000, 200)
    ragged = PointClouds.from_list([room(int(n), 1) for n in sizes])
    equal = PointClouds.from_list([room(int(sizes.mean()), 1)] * len(sizes))
    times = alternate(
        lambda: fit_em(ragged, 16, max_iterations=10, tolerance=None),
        lambda: fit_em(equal, 16, max_iterations=10, tolerance=None),
        runs,
    )
    yield Row(
        f"EM, {len(sizes)} ragged clouds of 500 to 60000 points", times[0], "equal sizes, same sum", times[1]
    )
    yield from coarse_to_fine()
    scan = PointClouds.from_list([room(30_000)])
    orders = list(range(8, 31, 2))
    times = alternate(
        lambda: fit_mdl(scan, orders, members=[0] * len(orders), n_init=5),
        lambda: [
            fit_mdl(scan, k, n_init=1, initializer="random_points", seed=i) for k in orders for i in range(5)
        ],
        1,
    )
    yield Row(
        "order search, K_max = 8, 10, ..., 30 x 5 starts of 30000 points",
        times[0],
        "loop of single calls",
        times[1],
    )


def coarse_to_fine() -> Iterator[Row]:
    """Order search on cells of at most 16 points, polished on all points, against the search on all points."""
    for n in (100_000, 1_000_000):
        clouds = PointClouds.from_list([room(n)])
        times = alternate(lambda: fit_mdl(clouds, 20, coarse=16), lambda: fit_mdl(clouds, 20), 1)  # noqa: B023
        worse = (fit_mdl(clouds, 20, coarse=16).mdl - fit_mdl(clouds, 20).mdl) / n
        yield Row(f"order search on cells, then all of {n} points", times[0], "on all points", times[1],
                  f"{float(worse[0]):+.4f} nats per point")  # fmt: skip


def removals(runs: int) -> Iterator[Row]:
    """Algorithm 2 for 100 pairs of mixtures, against the plain loop over POT."""
    a, b, cost = changed_rooms(0, 100, 16, 3)
    times = alternate(
        lambda: greedy_removals(*(torch.from_numpy(x) for x in (a, b, cost))),
        lambda: [plain.greedy_removals(*pair) for pair in zip(a, b, cost, strict=True)],
        runs,
    )
    yield Row("greedy EMD of 100 pairs, K = 16", times[0], "plain loop over POT", times[1])


def memory(num_points: int) -> str:
    """Peak resident memory above the input for a search of the order over one large cloud."""
    clouds = PointClouds.from_list([room(num_points)])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    fit_mdl(clouds, 20, max_iterations=2)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return f"peak memory above the input, order search over {num_points} points: {grown:.0f} MiB"


def as_mixtures(models: list) -> GaussianMixtures:
    """gmcluster's models as one batch."""
    return GaussianMixtures.from_list(
        [GaussianMixtures.from_arrays(m.weights, m.means, m.covariances) for m in models]
    )


def timed(call: Callable[[], object]) -> float:
    """Seconds of one call."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5, help="alternating runs of each comparison")
    parser.add_argument(
        "--only",
        choices=["memory", "em", "order", "batches", "removals", "precision"],
        help="one part of the table",
    )
    parser.add_argument(
        "--sizes", type=int, nargs="+", default=[10_000, 30_000, 100_000], help="points for EM"
    )
    parser.add_argument(
        "--small",
        action="store_true",
        help="tiny inputs and no batches: whether it runs, no figures to quote",
    )
    arguments = parser.parse_args()
    sizes, order_sizes, num_clouds, large = tuple(arguments.sizes), (10_000, 30_000), 10, 2_000_000
    if arguments.small:
        sizes, order_sizes, num_clouds, large = (10_000,), (1_000,), 2, 50_000
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
    )
    print(f"{platform.processor() or platform.machine()}, {torch.get_num_threads()} threads, torch "
          f"{torch.__version__}, gmmtorch {commit.stdout.strip() or 'installed'}")  # fmt: skip
    parts = {
        "memory": lambda: iter([memory(large)]),
        "em": lambda: fixed_order(1 if arguments.small else arguments.runs, sizes),
        "order": lambda: (row for n in order_sizes for row in order_search(n, num_clouds)),
        "batches": lambda: iter(()) if arguments.small else batches(arguments.runs),
        "removals": lambda: removals(arguments.runs),
        "precision": lambda: precision((1_000,) if arguments.small else sizes, num_clouds),
    }
    print(f"{'':<58} {'ours (s)':>9} {'peer (s)':>9}  {'ratio':>6}  peer")
    for name, rows in parts.items():
        if arguments.only in (None, name):
            for row in rows():
                print(row, flush=True)


if __name__ == "__main__":
    main()
