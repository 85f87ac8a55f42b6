"""Clouds that the tests and the benchmarks share, all made by code and seeded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROOM_SIZE = (6.0, 4.0, 3.0)  # m
NOISE = 0.01  # m, standard deviation of the range noise


def room(num_points: int, seed: int = 0, noise: float = NOISE) -> Array:
    """A scanned room (N, 3), m: floor, four walls, two boxes and two cylinders, points spread by area."""
    rng = np.random.default_rng(seed)
    length, width, height = ROOM_SIZE
    surfaces = [
        _rectangle((0, 0, 0), (length, 0, 0), (0, width, 0)),
        _rectangle((0, 0, 0), (length, 0, 0), (0, 0, height)),
        _rectangle((0, width, 0), (length, 0, 0), (0, 0, height)),
        _rectangle((0, 0, 0), (0, width, 0), (0, 0, height)),
        _rectangle((length, 0, 0), (0, width, 0), (0, 0, height)),
        *_box((1.0, 1.0, 0.0), (0.8, 0.5, 0.9)),
        *_box((4.2, 2.4, 0.0), (1.2, 0.9, 0.6)),
        _cylinder((3.0, 1.2, 0.0), 0.25, 1.8),
        _cylinder((1.6, 3.0, 0.0), 0.35, 0.8),
    ]
    areas = np.array([area for area, _ in surfaces])
    counts = rng.multinomial(num_points, areas / areas.sum())
    points = np.concatenate([draw(rng, n) for n, (_, draw) in zip(counts, surfaces, strict=True)])
    return rng.permutation(points) + rng.normal(0.0, noise, points.shape)


def mixture_parameters(num_components: int, dim: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Weights (K,), means (K, D) and well-conditioned covariances (K, D, D) of a random mixture."""
    rng = np.random.default_rng(seed)
    factors = rng.normal(size=(num_components, dim, dim))
    covariances = factors @ factors.transpose(0, 2, 1) / dim + 0.1 * np.eye(dim)
    return (
        rng.dirichlet(np.full(num_components, 5.0)),
        4.0 * rng.normal(size=(num_components, dim)),
        covariances,
    )


def blobs(num_points: int, dim: int = 3, num_components: int = 4, seed: int = 0) -> Array:
    """Points of a random mixture (N, D)."""
    rng = np.random.default_rng(seed + 1)
    weights, means, covariances = mixture_parameters(num_components, dim, seed)
    component = rng.choice(num_components, num_points, p=weights)
    noise = rng.normal(size=(num_points, dim, 1))
    return means[component] + (np.linalg.cholesky(covariances)[component] @ noise)[..., 0]


def hostile_clouds() -> dict[str, Array]:
    """Clouds that break careless code, by name (N, 3)."""
    rng = np.random.default_rng(7)
    plane = np.column_stack([rng.uniform(-2, 2, (300, 2)), np.zeros(300)])
    tilted = plane @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    line = rng.uniform(-1, 1, (200, 1)) * np.array([[1.0, 2.0, -0.5]])
    return {
        "empty": np.zeros((0, 3)),
        "one point": np.array([[1.0, 2.0, 3.0]]),
        "two points": np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        "fewer points than components": rng.normal(size=(5, 3)),
        "duplicates": np.repeat(rng.normal(size=(6, 3)), 30, axis=0),
        "mostly one point": np.concatenate([np.zeros((90, 3)), rng.normal(size=(30, 3))]),
        "all identical": np.full((40, 3), 2.5),
        "collinear": line,
        "coplanar": plane,
        "tilted plane": tilted,
        "far outlier": np.concatenate([room(500, 3), [[1e9, 0.0, 0.0]]]),
        "two far outliers": np.concatenate([room(500, 4), [[1e6, 0.0, 0.0], [0.0, -1e12, 0.0]]]),
        "nanometres": 1e-9 * room(400, 5),
        "gigametres": 1e9 * room(400, 6),
        "map coordinates": room(400, 7) + 5e5,
        "not finite": np.array([[0.0, 0.0, 0.0], [np.nan, 1.0, 2.0], [1.0, 1.0, np.inf]]),
    }


Surface = tuple[float, Callable[[np.random.Generator, int], Array]]


def _rectangle(corner: tuple[float, ...], first: tuple[float, ...], second: tuple[float, ...]) -> Surface:
    origin, u, v = (np.asarray(x, dtype=float) for x in (corner, first, second))

    def draw(rng: np.random.Generator, n: int) -> Array:
        return origin + rng.uniform(size=(n, 1)) * u + rng.uniform(size=(n, 1)) * v

    return float(np.linalg.norm(np.cross(u, v))), draw


def _box(corner: tuple[float, float, float], size: tuple[float, float, float]) -> list[Surface]:
    """The four sides and the top."""
    x, y, z = corner
    a, b, c = size
    return [
        _rectangle((x, y, z), (a, 0, 0), (0, 0, c)),
        _rectangle((x, y + b, z), (a, 0, 0), (0, 0, c)),
        _rectangle((x, y, z), (0, b, 0), (0, 0, c)),
        _rectangle((x + a, y, z), (0, b, 0), (0, 0, c)),
        _rectangle((x, y, z + c), (a, 0, 0), (0, b, 0)),
    ]


def _cylinder(foot: tuple[float, float, float], radius: float, height: float) -> Surface:
    def draw(rng: np.random.Generator, n: int) -> Array:
        angle = rng.uniform(0, 2 * np.pi, n)
        around = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0, height, n)])
        return np.asarray(foot) + around

    return 2 * np.pi * radius * height, draw
