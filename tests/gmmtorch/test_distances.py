"""Distances between components: accuracy against 50-digit arithmetic, invariances, degenerate matrices."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.distance import cdist
from torch.utils._python_dispatch import TorchDispatchMode

from gmmtorch import distances
from tests.reference import distances as reference

PAIRS_PER_CASE = 40


def random_rotations(generator: np.random.Generator, count: int, dimension: int) -> np.ndarray:
    return np.linalg.qr(generator.normal(size=(count, dimension, dimension)))[0]


def covariances_with(generator: np.random.Generator, eigenvalues: np.ndarray) -> np.ndarray:
    rotation = random_rotations(generator, *eigenvalues.shape)
    matrices = rotation * eigenvalues[:, None, :] @ rotation.transpose(0, 2, 1)
    return (matrices + matrices.transpose(0, 2, 1)) / 2


def random_covariances(
    generator: np.random.Generator, count: int, condition: float, dimension: int = 3
) -> np.ndarray:
    """Covariances of exactly the given condition, the eigenvalues between log-uniform."""
    exponents = generator.uniform(size=(count, dimension))
    exponents[:, 0] = 0
    if dimension > 1:
        exponents[:, -1] = 1
    return covariances_with(generator, condition**exponents * 10 ** generator.uniform(-4, 0, size=(count, 1)))


def pairwise(function, *columns: np.ndarray) -> np.ndarray:
    return np.array([function(*row) for row in zip(*columns, strict=True)])


def one_by_one(matrices: np.ndarray) -> torch.Tensor:
    """P matrices as P mixtures of one component (P, 1, D, D)."""
    return torch.from_numpy(matrices)[:, None]


def assert_within_the_bar(a: np.ndarray, b: np.ndarray) -> None:
    found = distances.covariance_distance(one_by_one(a), one_by_one(b)).numpy().ravel()
    expected = pairwise(reference.covariance_distance, a, b)
    bar = 1e-15 * np.maximum(np.linalg.cond(a), np.linalg.cond(b)) + 1e-9
    assert (np.abs(found - expected) <= bar).all()


@pytest.mark.parametrize("condition", [1.0, 10.0, 1e4, 1e6, 1e8, 1e9])
@pytest.mark.parametrize("other", ["same", "round"])
def test_covariance_distance_is_accurate(condition: float, other: str):
    generator = np.random.default_rng(int(condition) + len(other))
    a = random_covariances(generator, PAIRS_PER_CASE, condition)
    b = random_covariances(generator, PAIRS_PER_CASE, condition if other == "same" else 2.0)
    assert_within_the_bar(a, b)


@pytest.mark.parametrize("condition", [1.0, 100.0, 1e6, 1e9])
@pytest.mark.parametrize("pattern", ["disc", "needle"])
def test_covariance_distance_of_repeated_eigenvalues_is_accurate(condition: float, pattern: str):
    generator = np.random.default_rng(7)
    eigenvalues = {"disc": [1.0, condition, condition], "needle": [1.0, 1.0, condition]}[pattern]
    a = covariances_with(generator, np.tile(eigenvalues, (PAIRS_PER_CASE, 1)))
    identities = np.tile(np.eye(3), (PAIRS_PER_CASE, 1, 1))
    assert_within_the_bar(a, identities)
    assert_within_the_bar(a, 4.0 * a)  # the three generalised eigenvalues coincide
    diagonal = np.tile(np.diag(eigenvalues), (PAIRS_PER_CASE, 1, 1))
    assert_within_the_bar(diagonal, identities)
    assert_within_the_bar(a, covariances_with(generator, np.tile(eigenvalues, (PAIRS_PER_CASE, 1))))


@pytest.mark.parametrize("step", [0.0, 1e-15, 1e-12, 1e-8, 1e-5])
def test_covariance_distance_is_accurate_where_eigenvalues_nearly_coincide(step: float):
    generator = np.random.default_rng(8)
    near = np.tile([1.0, 1.0 + step, 1.0 + 2 * step], (PAIRS_PER_CASE, 1))
    a = covariances_with(generator, near)
    for b in (np.eye(3), 0.3 * np.eye(3), np.diag([1.0, 2.0, 2.0 + step])):
        assert_within_the_bar(a, np.tile(b, (PAIRS_PER_CASE, 1, 1)))


def test_isotropic_matrices_have_the_distance_of_their_scale():
    identity = torch.eye(3, dtype=torch.float64)[None, None]
    found = distances.covariance_distance(5.0 * identity, identity)
    torch.testing.assert_close(found, torch.full((1, 1, 1), math.sqrt(3) * math.log(5), dtype=torch.float64))


@pytest.mark.parametrize("dimension", [1, 2, 4, 7])
def test_covariance_distance_in_other_dimensions(dimension: int):
    generator = np.random.default_rng(dimension)
    condition = 1e4 if dimension > 1 else 1.0
    a = random_covariances(generator, PAIRS_PER_CASE, condition, dimension)
    b = random_covariances(generator, PAIRS_PER_CASE, condition, dimension)
    assert_within_the_bar(a, b)


@pytest.mark.parametrize("dimension", [2, 3])
def test_covariance_distance_is_symmetric_and_zero_on_equal_matrices(dimension: int):
    a = torch.from_numpy(random_covariances(np.random.default_rng(1), 12, 1e6, dimension)).reshape(
        2, 6, dimension, dimension
    )
    found = distances.covariance_distance(a, a)
    assert (found.diagonal(dim1=1, dim2=2) == 0).all()
    torch.testing.assert_close(found, found.mT, rtol=0, atol=1e-9)
    assert (found + torch.eye(6)).min() > 0.01


def test_rigid_motion_leaves_every_distance_unchanged():
    generator = np.random.default_rng(2)
    a, b = (torch.from_numpy(random_covariances(generator, 8, 1e4)).reshape(1, 8, 3, 3) for _ in range(2))
    mean_a, mean_b = (torch.from_numpy(generator.normal(size=(1, 8, 3))) for _ in range(2))
    rotation = torch.from_numpy(random_rotations(generator, 1, 3)[0])
    shift = torch.tensor([4e3, -2e3, 10.0], dtype=torch.float64)

    def moved(means, covariances):
        turned = rotation @ covariances @ rotation.T
        return means @ rotation.T + shift, (turned + turned.mT) / 2

    for name in distances.GROUND_DISTANCES:
        before = distances.ground_distance(name, mean_a, a, mean_b, b)
        after = distances.ground_distance(name, *moved(mean_a, a), *moved(mean_b, b))
        torch.testing.assert_close(before, after, rtol=1e-9, atol=1e-9)
    before = distances.symmetric_kl(mean_a, a, mean_b, b)
    torch.testing.assert_close(
        before, distances.symmetric_kl(*moved(mean_a, a), *moved(mean_b, b)), rtol=1e-7, atol=0
    )


@pytest.mark.parametrize("dimension", [1, 2, 3, 5])
@pytest.mark.parametrize("condition", [1.0, 1e4, 1e8])
def test_bures_distance_and_symmetric_kl_match_their_definitions(dimension: int, condition: float):
    condition = condition if dimension > 1 else 1.0
    generator = np.random.default_rng(3)
    a = random_covariances(generator, 20, condition, dimension)
    b = random_covariances(generator, 20, condition, dimension)
    mean_a, mean_b = generator.normal(scale=0.1, size=(2, 20, dimension))
    tensors = [torch.from_numpy(x)[:, None] for x in (mean_a, a, mean_b, b)]

    bures = distances.bures_distance(*tensors).numpy().ravel()
    np.testing.assert_allclose(bures, pairwise(reference.bures_distance, mean_a, a, mean_b, b), rtol=1e-7)
    kl = distances.symmetric_kl(*tensors).numpy().ravel()
    tolerance = 1e-14 * condition + 1e-12
    np.testing.assert_allclose(kl, pairwise(reference.symmetric_kl, mean_a, a, mean_b, b), rtol=tolerance)


def test_bures_distance_of_flat_axis_aligned_gaussians():
    flat = torch.diag(torch.tensor([4.0, 1.0, 1e-12], dtype=torch.float64))[None, None]
    origin = torch.zeros(1, 1, 3, dtype=torch.float64)
    assert distances.bures_distance(origin, flat, origin, flat).item() < 1e-7
    # Axis-aligned Gaussians: the distance of the standard deviations.
    found = distances.bures_distance(origin, flat, origin, torch.eye(3, dtype=torch.float64)[None, None])
    assert found.item() == pytest.approx(math.sqrt(1 + 0 + (1 - 1e-6) ** 2), abs=1e-12)


def test_mean_distance_is_accurate_far_from_the_origin():
    generator = np.random.default_rng(4)
    a, b = generator.normal(size=(2, 3, 30, 3)) + 5e5
    found = distances.mean_distance(torch.from_numpy(a), torch.from_numpy(b)).numpy()
    expected = np.stack([cdist(x, y) for x, y in zip(a, b, strict=True)])
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_combined_distance_is_the_larger_of_the_two_in_units_of_the_length_scale():
    generator = np.random.default_rng(5)
    a, b = (torch.from_numpy(random_covariances(generator, 6, 10.0)).reshape(2, 3, 3, 3) for _ in range(2))
    mean_a, mean_b = (torch.from_numpy(generator.normal(size=(2, 3, 3))) for _ in range(2))
    d_mean, d_covariance = distances.mean_distance(mean_a, mean_b), distances.covariance_distance(a, b)
    found = distances.combined_distance(mean_a, a, mean_b, b, length_scale=0.5)
    torch.testing.assert_close(found, torch.maximum(2 * d_mean, d_covariance))
    assert (found == d_covariance).any()
    assert (found == 2 * d_mean).any()
    with pytest.raises(ValueError, match="length_scale"):
        distances.combined_distance(mean_a, a, mean_b, b, length_scale=0.0)


def test_a_matrix_that_is_not_positive_definite_spoils_only_its_own_row():
    a = torch.eye(3, dtype=torch.float64).repeat(1, 3, 1, 1)
    a[0, 1, 2, 2] = -1.0
    means = torch.zeros(1, 3, 3, dtype=torch.float64)
    b = 2 * torch.eye(3, dtype=torch.float64).repeat(1, 2, 1, 1)
    for found in (
        distances.covariance_distance(a, b),
        distances.bures_distance(means, a, means[:, :2], b),
        distances.symmetric_kl(means, a, means[:, :2], b),
    ):
        assert found[0, 1].isnan().all()
        assert found[0, [0, 2]].isfinite().all()


def test_a_batch_equals_its_members_and_float32_input_is_raised_to_float64():
    generator = np.random.default_rng(6)
    a = torch.from_numpy(random_covariances(generator, 12, 1e3)).reshape(3, 4, 3, 3)
    b = torch.from_numpy(random_covariances(generator, 15, 1e3)).reshape(3, 5, 3, 3)
    mean_a, mean_b = (torch.from_numpy(generator.normal(size=(3, k, 3))) for k in (4, 5))
    for name in distances.GROUND_DISTANCES:
        whole = distances.ground_distance(name, mean_a, a, mean_b, b, length_scale=2.0)
        assert whole.shape == (3, 4, 5)
        for i in range(3):
            member = slice(i, i + 1)
            alone = distances.ground_distance(
                name, mean_a[member], a[member], mean_b[member], b[member], length_scale=2.0
            )
            torch.testing.assert_close(whole[member], alone, rtol=0, atol=0)
        single = distances.ground_distance(name, mean_a.float(), a.float(), mean_b.float(), b.float())
        assert single.dtype == torch.float64


def test_hellinger_distance_equals_its_integral():
    generator = np.random.default_rng(7)
    factors = [generator.normal(size=(1, k, 3, 3)) for k in (2, 3)]
    a, b = (torch.from_numpy(f @ f.swapaxes(2, 3) + 0.1 * np.eye(3)) for f in factors)
    mean_a, mean_b = (torch.from_numpy(generator.normal(size=(1, k, 3))) for k in (2, 3))
    axis = np.linspace(-16, 16, 100)
    grid = torch.from_numpy(np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3))

    def roots(means, covariances):
        normal = torch.distributions.MultivariateNormal(means[0][:, None], covariances[0][:, None])
        return normal.log_prob(grid).exp().sqrt()  # (K, N)

    overlap = roots(mean_a, a) @ roots(mean_b, b).T * (axis[1] - axis[0]) ** 3
    found = distances.hellinger_distance(mean_a, a, mean_b, b)[0]
    torch.testing.assert_close(found.square(), 1 - overlap, atol=2e-3, rtol=0)


def test_hellinger_distance_keeps_its_bounds():
    generator = np.random.default_rng(8)
    a = torch.from_numpy(random_covariances(generator, 4, 1e3)).reshape(1, 4, 3, 3)
    means = torch.from_numpy(generator.normal(size=(1, 4, 3)))
    far = distances.hellinger_distance(means, a, means + 1e6, a)
    torch.testing.assert_close(far, torch.ones(1, 4, 4, dtype=torch.float64))
    assert distances.hellinger_distance(means, a, means, a)[0].diagonal().max() < 1e-6


def test_an_unknown_ground_distance_names_the_known_ones():
    empty = torch.zeros(1, 1, 3), torch.eye(3)[None, None]
    with pytest.raises(ValueError, match="mean, bures, combined, hellinger"):
        distances.ground_distance("euclid", *empty, *empty)


class ForbidSynchronisation(TorchDispatchMode):
    """Fails on operations whose result or shape the host must wait for."""

    forbidden = ("_local_scalar_dense", "nonzero", "masked_select", "unique", "eigh", "svd")

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        assert not any(name in str(func) for name in self.forbidden), f"{func} synchronises"
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("device", ["cpu", "meta"])
def test_distances_in_three_dimensions_never_wait_for_the_device(device: str):
    means = torch.zeros(2, 4, 3, device=device)
    covariances = torch.eye(3, device=device).repeat(2, 4, 1, 1)
    problem = means, covariances, means[:, :3], covariances[:, :3]
    with ForbidSynchronisation():
        for name in distances.GROUND_DISTANCES:
            assert distances.ground_distance(name, *problem).shape == (2, 4, 3)
        assert distances.symmetric_kl(*problem).shape == (2, 4, 3)


def test_the_guard_against_synchronisation_notices_it():
    with pytest.raises(AssertionError, match="synchronises"), ForbidSynchronisation():
        torch.ones(1).item()
