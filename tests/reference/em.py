"""EM, merging and eq. 6 as plain loops over points and components, in float64: slow and easy to check by eye."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Mixture(NamedTuple):
    """Weights (K,), means (K, D), covariances (K, D, D)."""

    weights: Array
    means: Array
    covariances: Array


def log_gaussian(x: Array, mean: Array, covariance: Array) -> float:
    """log N(x; mean, covariance) of one point (D,)."""
    away = x - mean
    _, log_det = np.linalg.slogdet(covariance)
    return float(-0.5 * (len(x) * np.log(2 * np.pi) + log_det + away @ np.linalg.solve(covariance, away)))


def expectation(points: Array, spreads: Array, mixture: Mixture) -> tuple[Array, Array]:
    """Responsibilities (N, K) and log p per point or cell (N,), nats."""
    logits = np.empty((len(points), len(mixture.weights)))
    for n, (x, spread) in enumerate(zip(points, spreads, strict=True)):
        for k, (weight, mean, covariance) in enumerate(zip(*mixture, strict=True)):
            penalty = 0.5 * np.trace(np.linalg.solve(covariance, spread))
            logits[n, k] = np.log(weight) + log_gaussian(x, mean, covariance) - penalty
    peak = logits.max(1, keepdims=True)
    likelihoods = np.exp(logits - peak)
    total = likelihoods.sum(1, keepdims=True)
    return likelihoods / total, (np.log(total) + peak)[:, 0]


def maximization(points: Array, weights: Array, spreads: Array, responsibilities: Array) -> Mixture:
    """The mixture that maximises the expected log-likelihood of weighted points or cells."""
    new = []
    for r in responsibilities.T:
        mass = (weights * r).sum()
        mean = sum(w * q * x for w, q, x in zip(weights, r, points, strict=True)) / mass
        covariance = np.zeros_like(spreads[0])
        for w, q, x, spread in zip(weights, r, points, spreads, strict=True):
            covariance += w * q * (np.outer(x - mean, x - mean) + spread)
        new.append((mass / weights.sum(), mean, covariance / mass))
    return Mixture(*(np.array(v) for v in zip(*new, strict=True)))


def description_length(log_likelihood: float, num_components: int, total: float, dim: int) -> float:
    """Eq. 6."""
    num_parameters = num_components * (1 + dim + dim * (dim + 1) / 2) - 1
    return -log_likelihood + 0.5 * num_parameters * np.log(total * dim)


def union(mixture: Mixture, left: int, right: int) -> tuple[float, Array, Array]:
    """Weight, mean and covariance of two components taken as one."""
    a, b = mixture.weights[left], mixture.weights[right]
    mean = (a * mixture.means[left] + b * mixture.means[right]) / (a + b)
    covariance = np.zeros_like(mixture.covariances[0])
    for share, k in ((a, left), (b, right)):
        away = mixture.means[k] - mean
        covariance += share / (a + b) * (mixture.covariances[k] + np.outer(away, away))
    return float(a + b), mean, covariance


def merge_distance(mixture: Mixture, left: int, right: int, total: float) -> float:
    """d(l, m), eq. 7."""
    _, _, covariance = union(mixture, left, right)
    log_det = np.linalg.slogdet(covariance)[1]
    return float(
        sum(0.5 * total * mixture.weights[k] * (log_det - np.linalg.slogdet(mixture.covariances[k])[1])
            for k in (left, right))
    )  # fmt: skip


def merge_closest(mixture: Mixture, total: float) -> Mixture:
    """Join the pair of least d(l, m), in the first one's place."""
    pairs = [(a, b) for a in range(len(mixture.weights)) for b in range(a + 1, len(mixture.weights))]
    left, right = min(pairs, key=lambda pair: merge_distance(mixture, *pair, total))
    new = union(mixture, left, right)
    parts = []
    for values, joined in zip(mixture, new, strict=True):
        kept = values.copy()
        kept[left] = joined
        parts.append(np.delete(kept, right, axis=0))
    return Mixture(*parts)
