"""How exact the engine is: the figures behind its use of float32, and of eq. 10 in float64. Printed, not timed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from gmmtorch import PointClouds, covariance_distance, fit_em, fit_mdl
from tests.helpers import room
from tests.reference.distances import covariance_distance as exact_distance

OFFSETS = (0.0, 20.0, 200.0, 5e5)


def precision(sizes: tuple[int, ...], num_clouds: int) -> Iterator[str]:
    """Every line of the section, for clouds of these sizes."""
    for size in sizes:
        yield em_in_single(size, num_clouds)
        yield monotone_in_single(size, num_clouds)
    for size in sizes:
        yield order_in_single(size, num_clouds)
    yield distances()


def em_in_single(size: int, num_clouds: int) -> str:
    """50 iterations from one start in float32 and float64, both valued in float64, at several offsets."""
    apart = []
    for offset in OFFSETS:
        points = [room(size, seed) + offset for seed in range(num_clouds)]
        double, single = both(points)
        start = fit_em(double, 20, max_iterations=0, tolerance=None).mixtures
        reached = [
            fit_em(clouds, initial=start, max_iterations=50, tolerance=None) for clouds in (double, single)
        ]
        valued = [fit_em(double, initial=result.mixtures, max_iterations=0) for result in reached]
        apart.append(float((valued[0].log_likelihood - valued[1].log_likelihood).abs().max()))
    listed = ", ".join(f"{value:.3f}" for value in apart)
    return (
        f"float32 against float64 after 50 iterations, {num_clouds} x {size}: at most {listed} nats at offsets of "
        f"{', '.join(f'{offset:g}' for offset in OFFSETS)} m"
    )


def monotone_in_single(size: int, num_clouds: int) -> str:
    """The least gain of one iteration in float32, objectives valued in float64."""
    double, single = both([room(size, seed) for seed in range(num_clouds)])
    mixtures = fit_em(double, 20, max_iterations=0, tolerance=None).mixtures
    before, least = fit_em(double, initial=mixtures, max_iterations=0).objective, np.inf
    for _ in range(50):
        mixtures = fit_em(single, initial=mixtures, max_iterations=1, tolerance=None).mixtures
        after = fit_em(double, initial=mixtures, max_iterations=0).objective
        least = min(least, float((after - before).min()))
        before = after
    return f"least gain of an iteration in float32, {num_clouds} x {size}: {least:.4f} nats"


def order_in_single(size: int, num_clouds: int) -> str:
    """Order search in both precisions."""
    double, single = (
        fit_mdl(clouds, 20) for clouds in both([room(size, seed) for seed in range(num_clouds)])
    )
    same = int((double.mixtures.num_components == single.mixtures.num_components).sum())
    apart = (single.mdl - double.mdl).abs()
    penalty = 0.5 * 10 * np.log(3 * size)
    near = int((apart <= penalty).sum())
    return (
        f"order search in float32, {num_clouds} x {size}: the same K for {same}, MDL within one component's penalty "
        f"({penalty:.0f} nats) for {near}; differences {', '.join(f'{value:.1f}' for value in apart.tolist())}"
    )


def distances(pairs: int = 200) -> str:
    """Error of the covariance distance against 50-digit arithmetic, over its bound 1e-15 max(cond) + 1e-9."""
    generator = np.random.default_rng(0)
    worst = 0.0
    for condition in (1.0, 1e2, 1e4, 1e6, 1e8, 1e9):
        for pattern in ([0.0, 0.5, 1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]):
            a, b = (rotated(generator, condition ** np.array(pattern), pairs) for _ in range(2))
            found = covariance_distance(*(torch.from_numpy(m)[:, None] for m in (a, b))).numpy().ravel()
            exact = np.array([exact_distance(x, y) for x, y in zip(a, b, strict=True)])
            bound = 1e-15 * np.maximum(np.linalg.cond(a), np.linalg.cond(b)) + 1e-9
            worst = max(worst, float((np.abs(found - exact) / bound).max()))
    return f"covariance distance, condition 1 to 1e9: error at most {worst:.2f} of 1e-15 max(cond) + 1e-9"


def rotated(generator: np.random.Generator, eigenvalues: np.ndarray, count: int) -> np.ndarray:
    """Covariances of these eigenvalues in random directions (count, 3, 3)."""
    turns = np.linalg.qr(generator.normal(size=(count, 3, 3)))[0]
    covariances = (turns * eigenvalues) @ turns.transpose(0, 2, 1)
    return (covariances + covariances.transpose(0, 2, 1)) / 2


def both(points: list[np.ndarray]) -> tuple[PointClouds, PointClouds]:
    """The same clouds for arithmetic in float64 and in float32."""
    return PointClouds.from_list(points), PointClouds.from_list(points, dtype=torch.float32)
