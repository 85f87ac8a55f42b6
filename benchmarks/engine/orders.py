"""The order search: beside gmcluster and scikit-learn, on a part of the points, and for many K_max at once."""

from __future__ import annotations

import statistics
import warnings
from collections.abc import Iterator

import numpy as np

from benchmarks.engine.timing import Row, alternate, timed
from gmmtorch import GaussianMixtures, PointClouds, description_length, fit_mdl
from tests.helpers import room

TIMED_BIC_LOOPS = 2
"""Clouds on which scikit-learn's loop is timed; the time of all is scaled from them."""


def beside_peers(n: int, num_clouds: int) -> Iterator[Row]:
    """All clouds in one call, against gmcluster and a BIC loop of scikit-learn, one run each."""
    points = [room(n, seed) for seed in range(num_clouds)]
    clouds = PointClouds.from_list(points)
    best = fit_mdl(clouds, 20)
    ours = statistics.median(timed(lambda: fit_mdl(clouds, 20)) for _ in range(5))
    found, seconds = _gmcluster(points)
    reached = description_length(found, clouds)
    remark = f"mean MDL {float(best.mdl.mean()):.0f} against {float(reached.mean()):.0f}"
    yield Row(f"order search, {num_clouds} x {n} points, K_max = 20", ours, "gmcluster", seconds, remark)
    few = min(TIMED_BIC_LOOPS, num_clouds)
    found, seconds = _scikit_learn(points[:few])
    reached = description_length(found, clouds.select(range(few)))
    remark = (
        f"mean MDL of {few} {float(best.mdl[:few].mean()):.0f} against {float(reached.mean()):.0f}; "
        f"time scaled from {few}"
    )
    yield Row("  the same", ours, "scikit-learn BIC loop", seconds / few * num_clouds, remark)


def _gmcluster(points: list[np.ndarray]) -> tuple[GaussianMixtures, float]:
    from gmcluster import GMModel

    models: list[GMModel] = []
    seconds = timed(lambda: models.extend(GMModel.estimate(x, max_clusters=20, alpha=1e-3) for x in points))
    mixtures = [GaussianMixtures.from_arrays(m.weights, m.means, m.covariances) for m in models]
    return GaussianMixtures.from_list(mixtures), seconds


def _scikit_learn(points: list[np.ndarray]) -> tuple[GaussianMixtures, float]:
    from sklearn.mixture import GaussianMixture

    chosen: list[GaussianMixture] = []

    def bic_loop() -> None:
        for x in points:
            fits = [GaussianMixture(k, random_state=0).fit(x) for k in range(1, 21)]
            chosen.append(min(fits, key=lambda model: model.bic(x)))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        seconds = timed(bic_loop)
    mixtures = [GaussianMixtures.from_arrays(m.weights_, m.means_, m.covariances_) for m in chosen]
    return GaussianMixtures.from_list(mixtures), seconds


def coarse_to_fine(n: int, num_rooms: int, runs: int) -> Iterator[Row]:
    """Order search on fewer points, polished on all, against the search on all; each room alone."""
    rooms = [PointClouds.from_list([room(n, seed)]) for seed in range(num_rooms)]
    full = [float(fit_mdl(clouds, 20).mdl) for clouds in rooms]
    for what, options in {
        "one point of 32": {"coarse": 32},
        "one point of 16": {"coarse": 16},
        "cells of 16": {"coarse": 16, "coarse_by": "cells"},
    }.items():
        times = np.array(
            [alternate(lambda: fit_mdl(x, 20, **options), lambda: fit_mdl(x, 20), runs) for x in rooms]  # noqa: B023
        )
        worse = [(float(fit_mdl(x, 20, **options).mdl) - m) / n for x, m in zip(rooms, full, strict=True)]
        yield Row(
            f"order search on {what}, then all of {n}", float(np.median(times[:, 0])), "on all points",
            float(np.median(times[:, 1])),
            f"{np.mean(worse):+.4f} nats per point ({min(worse):+.4f} to {max(worse):+.4f}, {num_rooms} rooms)",
        )  # fmt: skip


def many_orders(n: int) -> Iterator[Row]:
    """The sensitivity to K_max of one scan in one call, against a loop of single calls."""
    scan = PointClouds.from_list([room(n)])
    orders, starts = list(range(8, 31, 2)), range(5)
    grid = [(k, seed) for k in orders for seed in starts]
    options = {"initializer": "random_points"}
    times = alternate(
        lambda: fit_mdl(
            scan, [k for k, _ in grid], seed=[s for _, s in grid], members=[0] * len(grid), **options
        ),
        lambda: [fit_mdl(scan, k, seed=seed, **options) for k, seed in grid],
        1,
    )
    yield Row(
        f"order search, K_max = 8, 10, ..., 30 x 5 seeds of {n} points",
        times[0],
        "loop of single calls",
        times[1],
    )
