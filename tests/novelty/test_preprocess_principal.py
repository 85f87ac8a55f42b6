import numpy as np
import pytest
import torch

from novelty.preprocess.principal import principal_axes

ROWS, COLUMNS = (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)


def _covariances(spectrum, seed=0, count=300):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    return torch.as_tensor(axes * np.asarray(spectrum) @ axes.transpose(0, 2, 1))


SPECTRA = [
    (1, 2, 3),
    (0, 1, 2),
    (0, 0, 1),
    (1e-12, 0.4, 1),
    (1, 1, 1.1),
    (1e-20, 1e-18, 1e-17),
    (1e6, 3e7, 1e9),
]


@pytest.mark.parametrize("spectrum", SPECTRA)
def test_axes_and_surface_variation_are_those_of_eigh(spectrum):
    matrices = _covariances(spectrum)
    axes = principal_axes(matrices[:, ROWS, COLUMNS].T.contiguous())
    exact = torch.linalg.eigh(matrices)
    cosines = (axes.direction.T * exact.eigenvectors[:, :, 2]).sum(1).abs()
    assert (1 - cosines).abs().max() < 1e-12
    torch.testing.assert_close(axes.variance, exact.eigenvalues[:, 2], rtol=1e-9, atol=0)
    sigma = exact.eigenvalues[:, 0] / exact.eigenvalues.sum(1)
    torch.testing.assert_close(axes.surface_variation, sigma.clamp_min(0), rtol=0, atol=1e-7)


@pytest.mark.parametrize("spectrum", [(1, 1, 1), (0, 1, 1), (0.2, 1, 1 + 1e-9)])
def test_a_direction_is_principal_even_where_it_is_not_unique(spectrum):
    matrices = _covariances(spectrum)
    direction = principal_axes(matrices[:, ROWS, COLUMNS].T.contiguous()).direction.T[:, :, None]
    residual = matrices @ direction - max(spectrum) * direction
    assert residual.abs().max() < 1e-8
    torch.testing.assert_close(direction.norm(dim=1), torch.ones(300, 1, dtype=torch.float64))


def test_a_point_has_no_surface_variation():
    axes = principal_axes(torch.zeros(6, 4, dtype=torch.float64))
    assert torch.equal(axes.surface_variation, torch.zeros(4, dtype=torch.float64))
    assert torch.isfinite(axes.direction).all()
