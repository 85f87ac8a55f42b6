"""Component distances in 50-digit arithmetic, one pair at a time."""

import mpmath as mp
import numpy as np


def covariance_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Eq. 10: sqrt(sum ln^2 lambda_k(a, b))."""
    with mp.workdps(50):
        return float(mp.sqrt(sum(mp.log(root) ** 2 for root in _generalised_eigenvalues(a, b))))


def bures_distance(mean_a: np.ndarray, a: np.ndarray, mean_b: np.ndarray, b: np.ndarray) -> float:
    """sqrt(|mean_a - mean_b|^2 + tr a + tr b - 2 tr sqrt(a b))."""
    with mp.workdps(50):
        lower = mp.cholesky(_matrix(a))
        roots = mp.eigsy(lower.T * _matrix(b) * lower, eigvals_only=True)
        fidelity = sum(mp.sqrt(max(root, 0)) for root in roots)
        squared = sum(
            (mp.mpf(x) - mp.mpf(y)) ** 2 for x, y in zip(mean_a.tolist(), mean_b.tolist(), strict=True)
        )
        squared += sum(mp.mpf(x) for x in np.diag(a).tolist()) + sum(mp.mpf(x) for x in np.diag(b).tolist())
        return float(mp.sqrt(max(squared - 2 * fidelity, 0)))


def symmetric_kl(mean_a: np.ndarray, a: np.ndarray, mean_b: np.ndarray, b: np.ndarray) -> float:
    """KL(a||b) + KL(b||a), each from its own definition with its log-determinants."""
    with mp.workdps(50):
        return float(_kl(mean_a, a, mean_b, b) + _kl(mean_b, b, mean_a, a))


def _kl(mean_a: np.ndarray, a: np.ndarray, mean_b: np.ndarray, b: np.ndarray) -> mp.mpf:
    first, second = _matrix(a), _matrix(b)
    difference = _matrix(mean_b[:, None]) - _matrix(mean_a[:, None])
    inverse = mp.inverse(second)
    product = inverse * first
    trace = sum(product[i, i] for i in range(product.rows))
    quadratic = (difference.T * inverse * difference)[0]
    return (trace + quadratic - product.rows + mp.log(mp.det(second) / mp.det(first))) / 2


def _generalised_eigenvalues(a: np.ndarray, b: np.ndarray) -> list[mp.mpf]:
    lower = mp.inverse(mp.cholesky(_matrix(b)))
    whitened = lower * _matrix(a) * lower.T
    return list(mp.eigsy((whitened + whitened.T) / 2, eigvals_only=True))


def _matrix(values: np.ndarray) -> mp.matrix:
    return mp.matrix(values.tolist())
