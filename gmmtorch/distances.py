"""Distances between the components of two mixtures, for every pair of components of a whole batch at once.

Everything rests on one small matrix per pair of components. With the Cholesky factors A = L_a L_a^T and B =
L_b L_b^T, the squared singular values of the *relative factor* G = L_b^-1 L_a are the generalised
eigenvalues lambda_k(A, B). G is lower triangular, so for D = 3 it has six entries, written out below as six
tensors (B, K_a, K_b): no `eigh`, no (B, K_a, K_b, 3, 3) solve, and nothing that synchronises with a device.

The roots that eq. 10 needs are found so that flat components (walls: condition 1e6 to 1e9) do no harm. A
largest root is accurate in closed form, a smallest one is not. Hence: the largest of (A, B); the largest of
(B, A), which is one over the smallest of (A, B); and the middle one from the determinants. Where two roots
coincide the closed form errs by sqrt(machine epsilon), but the middle root then errs by the opposite
amount, and the sum of squared logarithms is left unharmed.

Everything is computed and returned in float64. A covariance that is not positive definite gives NaN in its
row or column only.
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import torch
from torch import Tensor

from gmmtorch import linalg
from gmmtorch.errors import ArgumentError

GroundDistance = Callable[[Tensor, Tensor, Tensor, Tensor, float], Tensor]
"""(means_a, covariances_a, means_b, covariances_b, length_scale) -> (B, K_a, K_b)."""

_Lower3 = tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]
"""The entries 11, 21, 22, 31, 32, 33 of a lower triangular or symmetric 3 x 3 matrix."""

_TINY = torch.finfo(torch.float64).tiny
_NEWTON_STEPS = 8  # of `_nuclear_norm_3`: quadratic from a start that is at most sqrt(3) too large


def mean_distance(means_a: Tensor, means_b: Tensor) -> Tensor:
    """Euclidean distance d_mu between every pair of means (section 2.4.2).

    Args:
        means_a: means of the first mixtures (B, K_a, D), m.
        means_b: means of the second mixtures (B, K_b, D), m.

    Returns:
        Distances (B, K_a, K_b), m. Equals `scipy.spatial.distance.cdist` of each mixture pair.
    """
    # Without the a^2 - 2ab + b^2 shortcut, which cancels at map coordinates of 5e5 m.
    return torch.cdist(means_a.double(), means_b.double(), compute_mode="donot_use_mm_for_euclid_dist")


def covariance_distance(covariances_a: Tensor, covariances_b: Tensor) -> Tensor:
    """Distance d_Sigma = sqrt(sum_k ln^2 lambda_k(A, B)) between every pair of covariances (eq. 10).

    Forstner and Moonen (1999); the affine-invariant metric of positive definite matrices. Its error is about
    1e-15 max(cond A, cond B). D = 3 never synchronises; other D take a batched singular value decomposition.

    Args:
        covariances_a: covariances of the first mixtures (B, K_a, D, D).
        covariances_b: covariances of the second mixtures (B, K_b, D, D).

    Returns:
        Distances (B, K_a, K_b), a pure number; exactly 0 for equal matrices, NaN where one is not positive
        definite.
    """
    factors_a, factors_b = _cholesky(covariances_a), _cholesky(covariances_b)
    if covariances_a.shape[-1] == 3:
        distance = _covariance_distance_3(factors_a, factors_b)
    else:
        roots = torch.linalg.svdvals(_relative_factors(factors_a, factors_b)).square()  # (B, K_a, K_b, D)
        distance = torch.linalg.vector_norm(roots.log(), dim=-1)
    equal = (factors_a[:, :, None] == factors_b[:, None, :]).all(dim=(-2, -1))  # NaN is never equal
    return torch.where(equal, 0.0, distance)


def combined_distance(
    means_a: Tensor, covariances_a: Tensor, means_b: Tensor, covariances_b: Tensor, length_scale: float = 1.0
) -> Tensor:
    """Distance d = max(d_mu / length_scale, d_Sigma) between every pair of components (eq. 9).

    Args:
        means_a: (B, K_a, D), m.
        covariances_a: (B, K_a, D, D), m^2.
        means_b: (B, K_b, D), m.
        covariances_b: (B, K_b, D, D), m^2.
        length_scale: the length, m, that weighs as much as one unit of d_Sigma. The paper compares metres
            with a pure number, which is `length_scale=1`.

    Returns:
        Distances (B, K_a, K_b), a pure number.

    Raises:
        ArgumentError: `length_scale` is not positive.
    """
    if not length_scale > 0:
        raise ArgumentError(f"length_scale must be a positive length in metres, but it is {length_scale}")
    scaled = mean_distance(means_a, means_b) / length_scale
    return torch.maximum(scaled, covariance_distance(covariances_a, covariances_b))


def bures_distance(means_a: Tensor, covariances_a: Tensor, means_b: Tensor, covariances_b: Tensor) -> Tensor:
    """Bures-Wasserstein distance (2-Wasserstein distance of two Gaussians) between every pair of components.

    d^2 = |mu_a - mu_b|^2 + tr A + tr B - 2 tr (A^1/2 B A^1/2)^1/2, whose last trace is the nuclear norm of
    L_a^T L_b. Its error is about 1e-8 sqrt(tr A + tr B) where the distance is nearly 0.

    Args:
        means_a: (B, K_a, D), m.
        covariances_a: (B, K_a, D, D), m^2.
        means_b: (B, K_b, D), m.
        covariances_b: (B, K_b, D, D), m^2.

    Returns:
        Distances (B, K_a, K_b), m; NaN where a covariance is not positive definite.
    """
    factors_a, factors_b = _cholesky(covariances_a), _cholesky(covariances_b)
    product = factors_a.mT[:, :, None] @ factors_b[:, None, :]  # (B, K_a, K_b, D, D)
    traces_of_roots = _nuclear_norm_3(product) if product.shape[-1] == 3 else _nuclear_norm(product)
    traces = _trace(covariances_a.double())[:, :, None] + _trace(covariances_b.double())[:, None, :]
    squared = mean_distance(means_a, means_b).square() + (traces - 2 * traces_of_roots).clamp_min(0)
    return squared.sqrt()


def hellinger_distance(
    means_a: Tensor, covariances_a: Tensor, means_b: Tensor, covariances_b: Tensor
) -> Tensor:
    """Hellinger distance sqrt(1 - integral sqrt(p q)) between every pair of components.

    It takes place and shape together and has no unit, so one value means the same on a table and in a hall; and
    since it saturates, a component without counterpart costs the same however far the next one is.

    Args:
        means_a: (B, K_a, D), m.
        covariances_a: (B, K_a, D, D), m^2.
        means_b: (B, K_b, D), m.
        covariances_b: (B, K_b, D, D), m^2.

    Returns:
        Distances (B, K_a, K_b) in [0, 1]: 0 the same, 1 no overlap; NaN where a covariance is not positive definite.
    """
    means_a, means_b = means_a.double(), means_b.double()
    covariances_a, covariances_b = covariances_a.double(), covariances_b.double()
    factor = _cholesky((covariances_a[:, :, None] + covariances_b[:, None, :]) / 2)  # (B, K_a, K_b, D, D)
    difference = (means_a[:, :, None] - means_b[:, None, :])[..., None]
    whitened = torch.linalg.solve_triangular(factor, difference, upper=False).squeeze(-1)
    volumes_a, volumes_b = (linalg.log_determinant(_cholesky(c)) for c in (covariances_a, covariances_b))
    spread = linalg.log_determinant(factor) - (volumes_a[:, :, None] + volumes_b[:, None, :]) / 2
    bhattacharyya = whitened.square().sum(-1) / 8 + spread / 2
    return (-torch.expm1(-bhattacharyya.clamp_min(0))).sqrt()


def symmetric_kl(means_a: Tensor, covariances_a: Tensor, means_b: Tensor, covariances_b: Tensor) -> Tensor:
    """Jeffreys divergence KL(a||b) + KL(b||a) between every pair of components.

    1/2 [tr B^-1 A + tr A^-1 B - 2D + (mu_a - mu_b)^T (A^-1 + B^-1) (mu_a - mu_b)]: no determinants are left.

    Args:
        means_a: (B, K_a, D), m.
        covariances_a: (B, K_a, D, D), m^2.
        means_b: (B, K_b, D), m.
        covariances_b: (B, K_b, D, D), m^2.

    Returns:
        Divergences (B, K_a, K_b), nats; not a metric (no triangle inequality).
    """
    factors_a, factors_b = _cholesky(covariances_a), _cholesky(covariances_b)
    difference = means_a.double()[:, :, None] - means_b.double()[:, None, :]  # (B, K_a, K_b, D)
    inverse_a, inverse_b = _inverse_lower(factors_a)[:, :, None], _inverse_lower(factors_b)[:, None, :]
    traces = (inverse_b @ factors_a[:, :, None]).square() + (inverse_a @ factors_b[:, None, :]).square()
    mahalanobis = (inverse_a @ difference[..., None]).square() + (inverse_b @ difference[..., None]).square()
    dimension = difference.shape[-1]
    shapes = (traces.sum(dim=(-2, -1)) - 2 * dimension).clamp_min(0)
    return (shapes + mahalanobis.sum(dim=(-2, -1))) / 2


def ground_distance(
    name: str,
    means_a: Tensor,
    covariances_a: Tensor,
    means_b: Tensor,
    covariances_b: Tensor,
    *,
    length_scale: float = 1.0,
) -> Tensor:
    """The ground distance `name` between every pair of components.

    Args:
        name: a key of `GROUND_DISTANCES`: "mean" (the paper's), "bures", "combined" (eq. 9) or
            "hellinger".
        means_a: (B, K_a, D), m.
        covariances_a: (B, K_a, D, D), m^2.
        means_b: (B, K_b, D), m.
        covariances_b: (B, K_b, D, D), m^2.
        length_scale: m; only "combined" uses it.

    Returns:
        Distances (B, K_a, K_b).

    Raises:
        ArgumentError: `name` is not registered.
    """
    if name not in GROUND_DISTANCES:
        raise ArgumentError(
            f"expected a ground distance out of {', '.join(GROUND_DISTANCES)}, but got {name!r}"
        )
    return GROUND_DISTANCES[name](means_a, covariances_a, means_b, covariances_b, length_scale)


GROUND_DISTANCES: Mapping[str, GroundDistance] = MappingProxyType(
    {
        "mean": lambda means_a, _a, means_b, _b, _scale: mean_distance(means_a, means_b),
        "bures": lambda means_a, a, means_b, b, _scale: bures_distance(means_a, a, means_b, b),
        "combined": combined_distance,
        "hellinger": lambda means_a, a, means_b, b, _scale: hellinger_distance(means_a, a, means_b, b),
    }
)
"""Ground distances by name."""


def _cholesky(covariances: Tensor) -> Tensor:
    """Lower factors (B, K, D, D) in float64, NaN where a covariance is not positive definite."""
    factors, positive = linalg.safe_cholesky(covariances.double())
    return torch.where(positive[..., None, None], factors, math.nan)


def _inverse_lower(factors: Tensor) -> Tensor:
    """Inverses (B, K, D, D) of lower triangular factors."""
    identity = torch.eye(factors.shape[-1], dtype=factors.dtype, device=factors.device)
    return torch.linalg.solve_triangular(factors, identity.expand_as(factors), upper=False)


def _relative_factors(factors_a: Tensor, factors_b: Tensor) -> Tensor:
    """G = L_b^-1 L_a of every pair (B, K_a, K_b, D, D)."""
    return _inverse_lower(factors_b)[:, None, :] @ factors_a[:, :, None]


def _trace(matrices: Tensor) -> Tensor:
    """Traces (...) of matrices (..., D, D)."""
    return matrices.diagonal(dim1=-2, dim2=-1).sum(dim=-1)


def _covariance_distance_3(factors_a: Tensor, factors_b: Tensor) -> Tensor:
    """Eq. 10 for D = 3 (B, K_a, K_b): outer roots in closed form, the middle one from the determinants."""
    entries_a = _lower_entries(factors_a[:, :, None])
    entries_b = _lower_entries(factors_b[:, None, :])
    forward = _lower_product(_lower_entries(_inverse_lower(factors_b)[:, None, :]), entries_a)
    backward = _lower_product(_lower_entries(_inverse_lower(factors_a)[:, :, None]), entries_b)
    largest = _largest_root(_gram(forward)).log()
    smallest = -_largest_root(_gram(backward)).log()
    middle = (_log_determinant(entries_a) - _log_determinant(entries_b)) - (largest + smallest)
    return (largest.square() + smallest.square() + middle.square()).sqrt()


def _lower_entries(matrices: Tensor) -> _Lower3:
    """The six entries (...) of lower triangular matrices (..., 3, 3)."""
    (m11, _, _), (m21, m22, _), (m31, m32, m33) = (row.unbind(-1) for row in matrices.unbind(-2))
    return m11, m21, m22, m31, m32, m33


def _lower_product(x: _Lower3, y: _Lower3) -> _Lower3:
    """The product of two lower triangular matrices, broadcast."""
    x11, x21, x22, x31, x32, x33 = x
    y11, y21, y22, y31, y32, y33 = y
    return (
        x11 * y11,
        x21 * y11 + x22 * y21,
        x22 * y22,
        x31 * y11 + x32 * y21 + x33 * y31,
        x32 * y22 + x33 * y32,
        x33 * y33,
    )


def _gram(g: _Lower3) -> _Lower3:
    """The symmetric matrix G G^T of a lower triangular G."""
    g11, g21, g22, g31, g32, g33 = g
    return (
        g11 * g11,
        g21 * g11,
        g21 * g21 + g22 * g22,
        g31 * g11,
        g31 * g21 + g32 * g22,
        g31 * g31 + g32 * g32 + g33 * g33,
    )


def _log_determinant(factor: _Lower3) -> Tensor:
    """Logarithm of det(L L^T)."""
    return 2 * (factor[0].log() + factor[2].log() + factor[5].log())


def _largest_root(h: _Lower3) -> Tensor:
    """Largest eigenvalue of symmetric 3 x 3 matrices, by the trigonometric formula (Smith 1961)."""
    h11, h21, h22, h31, h32, h33 = h
    centre = (h11 + h22 + h33) / 3
    d11, d22, d33 = h11 - centre, h22 - centre, h33 - centre
    off_diagonal = h21 * h21 + h31 * h31 + h32 * h32
    radius = ((d11 * d11 + d22 * d22 + d33 * d33 + 2 * off_diagonal) / 6).sqrt()
    scale = 1 / radius.clamp_min(_TINY)  # isotropic: radius 0, and every entry below is 0 instead of 0/0
    d11, d22, d33, d21, d31, d32 = (entry * scale for entry in (d11, d22, d33, h21, h31, h32))
    determinant = (
        d11 * (d22 * d33 - d32 * d32) - d21 * (d21 * d33 - d32 * d31) + d31 * (d21 * d32 - d22 * d31)
    )
    angle = (determinant / 2).clamp(-1, 1).acos() / 3
    return centre + 2 * radius * angle.cos()


def _nuclear_norm(matrices: Tensor) -> Tensor:
    """Sum of the singular values (...) of matrices (..., D, D)."""
    return torch.linalg.svdvals(matrices).sum(dim=-1)


def _nuclear_norm_3(matrices: Tensor) -> Tensor:
    """Sum of the singular values of matrices (..., 3, 3), without finding them.

    With s the sum, the invariants p = sum sigma_i^2, q = sum sigma_i^2 sigma_j^2 and r = |det| give
    s^2 = p + 2 sqrt(q + 2 r s). The difference of the two sides is convex in s, so Newton's method falls
    monotonically on the root from s = sqrt(3 p), which is never too small.
    """
    x, y, z = matrices.unbind(-2)
    minors = torch.linalg.cross(torch.stack([x, y, z], dim=-2), torch.stack([y, z, x], dim=-2))
    p = matrices.square().sum(dim=(-2, -1))
    q = minors.square().sum(dim=(-2, -1))
    r = (minors[..., 0, :] * z).sum(dim=-1).abs()
    total = (3 * p).sqrt()
    for _ in range(_NEWTON_STEPS):
        root = (q + 2 * r * total).sqrt()
        slope = 2 * (total - r / root.clamp_min(_TINY))
        total = total - (total * total - p - 2 * root) / slope.clamp_min(_TINY)
    return total
