"""Fuzzy k-means, fuzzy maximum-likelihood estimates and validity (Gath & Geva 1989) as plain loops in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def kmeans_memberships(points: Array, prototypes: Array) -> Array:
    """Eq. 2 at q = 2 (N, K)."""
    memberships = np.empty((len(points), len(prototypes)))
    for n, x in enumerate(points):
        distances = [np.sum((x - v) ** 2) for v in prototypes]
        for k, d in enumerate(distances):
            memberships[n, k] = (1 / d) / sum(1 / other for other in distances)
    return memberships


def prototypes_of(points: Array, memberships: Array) -> Array:
    """Eq. 3 at q = 2 (K, D)."""
    return np.array(
        [sum(u**2 * x for u, x in zip(us, points, strict=True)) / sum(us**2) for us in memberships.T]
    )


def covariances_of(points: Array, memberships: Array, prototypes: Array) -> Array:
    """Eq. 10 (K, D, D)."""
    found = []
    for us, v in zip(memberships.T, prototypes, strict=True):
        total = np.zeros((points.shape[1],) * 2)
        for u, x in zip(us, points, strict=True):
            total += u * np.outer(x - v, x - v)
        found.append(total / sum(us))
    return np.array(found)


def exponential_memberships(points: Array, shares: Array, prototypes: Array, covariances: Array) -> Array:
    """Eqs. 7 and 8 (N, K): the posterior by the exponential distance, as printed, not in the log domain."""
    memberships = np.empty((len(points), len(prototypes)))
    for n, x in enumerate(points):
        distances = []
        for p, v, f in zip(shares, prototypes, covariances, strict=True):
            exponent = (x - v) @ np.linalg.solve(f, x - v) / 2
            with np.errstate(over="ignore"):  # infinitely far is far enough
                distances.append(np.sqrt(np.linalg.det(f)) / p * np.exp(exponent))
        for k, d in enumerate(distances):
            memberships[n, k] = (1 / d) / sum(1 / other for other in distances)
    return memberships


def maximum_likelihood_step(points: Array, memberships: Array) -> Array:
    """One update of the memberships: P, V and F of these, and the posteriors of those."""
    prototypes = prototypes_of(points, memberships)
    covariances = covariances_of(points, memberships, prototypes)
    return exponential_memberships(points, memberships.mean(0), prototypes, covariances)


def settle(step, memberships: Array, tolerance: float, max_iterations: int) -> Array:
    """Repeat a step until no membership changes by more than the tolerance."""
    for _ in range(max_iterations):
        new = step(memberships)
        change = np.abs(new - memberships).max()
        memberships = new
        if change <= tolerance:
            break
    return memberships


def partition(
    points: Array, max_clusters: int, far: float, tolerance: float, max_iterations: int
) -> list[Array]:
    """Memberships (N, K) for K = 1 ... K_max; each K starts from the prototypes before and one far from all points."""
    points = points - points.mean(0)
    far_squared = far**2 * np.mean(np.sum(points**2, axis=1))
    prototypes = np.zeros((0, points.shape[1]))
    found = []
    for _ in range(max_clusters):
        nearness = np.array(
            [[1 / np.sum((x - v) ** 2) for v in prototypes] + [1 / far_squared] for x in points]
        )
        memberships = nearness / nearness.sum(1, keepdims=True)
        memberships = settle(
            lambda u: kmeans_memberships(points, prototypes_of(points, u)),
            memberships,
            tolerance,
            max_iterations,
        )
        memberships = settle(
            lambda u: maximum_likelihood_step(points, u), memberships, tolerance, max_iterations
        )
        prototypes = prototypes_of(points, memberships)
        found.append(memberships)
    return found


def validity(points: Array, memberships: Array) -> tuple[float, float, float]:
    """F_HV, D_PA and P_D (eqs. 13-17)."""
    prototypes = prototypes_of(points, memberships)
    covariances = covariances_of(points, memberships, prototypes)
    volumes, members = [], []
    for us, v, f in zip(memberships.T, prototypes, covariances, strict=True):
        volumes.append(np.sqrt(np.linalg.det(f)))
        members.append(
            sum(u for u, x in zip(us, points, strict=True) if (x - v) @ np.linalg.inv(f) @ (x - v) < 1)
        )
    average = float(np.mean([s / h for s, h in zip(members, volumes, strict=True)]))
    return sum(volumes), average, sum(members) / sum(volumes)
