"""Evaluation of mixtures against scipy and plain loops; sampling; storage."""

import numpy as np
import pytest
import torch
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from gmmtorch import ArgumentError, GaussianMixtures, PointClouds, SerializationError, ShapeError
from tests.helpers import blobs, mixture_parameters, room
from tests.reference import em as naive


@pytest.fixture
def mixtures():
    """Two mixtures of 4 and 2 components."""
    return GaussianMixtures.from_list(
        [GaussianMixtures.from_arrays(*mixture_parameters(k, 3, seed=k)) for k in (4, 2)]
    )


def clouds_of(*points, **kwargs):
    return PointClouds.from_list(list(points), **kwargs)


@pytest.mark.parametrize("dim", [1, 2, 3, 7])
def test_log_prob_equals_scipy(dim):
    weights, means, covariances = mixture_parameters(5, dim, seed=1)
    points = blobs(200, dim, seed=1)
    per_component = [
        multivariate_normal(m, c).logpdf(points) for m, c in zip(means, covariances, strict=True)
    ]
    expected = logsumexp(np.array(per_component), axis=0, b=weights[:, None])
    got = GaussianMixtures.from_arrays(weights, means, covariances).log_prob(clouds_of(points))
    np.testing.assert_allclose(got.numpy(), expected, rtol=1e-11, atol=1e-11)


def test_cells_get_the_bound_per_unit_weight():
    mixture = naive.Mixture(*mixture_parameters(3, 3))
    points, spreads = blobs(40), 0.1 * mixture_parameters(40, 3, seed=9)[2]
    responsibilities, values = naive.expectation(points, spreads, mixture)
    clouds = clouds_of(points, weights=[np.full(40, 7.0)], spreads=[spreads])
    ours = GaussianMixtures.from_arrays(*mixture)
    np.testing.assert_allclose(ours.log_prob(clouds).numpy(), values, rtol=1e-11)
    np.testing.assert_allclose(ours.responsibilities(clouds).numpy(), responsibilities, atol=1e-12)


def test_ragged_evaluation_matches_one_by_one(mixtures):
    points = [blobs(30, seed=3), blobs(9000, seed=4)]
    clouds = clouds_of(*points)
    posterior = mixtures.responsibilities(clouds)
    assert posterior.shape == (9030, 4)
    torch.testing.assert_close(posterior.sum(1), torch.ones(9030, dtype=torch.float64))
    assert (posterior[30:, 2:] == 0).all()
    assert torch.equal(mixtures.assign(clouds), posterior.argmax(1))
    for b in (0, 1):
        alone = mixtures[b].trim().log_prob(clouds_of(points[b]))
        assert torch.equal(clouds.split(mixtures.log_prob(clouds))[b], alone)


def test_evaluation_is_exact_far_from_the_origin():
    weights, means, covariances = mixture_parameters(3, 3)
    points = blobs(100)
    near = GaussianMixtures.from_arrays(weights, means, 1e-6 * covariances).log_prob(clouds_of(points))
    far = GaussianMixtures.from_arrays(weights, means + 2.0**19, 1e-6 * covariances).log_prob(
        clouds_of(points + 2.0**19)
    )
    torch.testing.assert_close(near, far, rtol=1e-3, atol=1e-3)


def test_an_empty_mixture_explains_nothing():
    empty = GaussianMixtures(
        torch.zeros(1, 2), torch.zeros(1, 2, 3), torch.eye(3).expand(1, 2, 3, 3), torch.tensor([0])
    )
    empty = GaussianMixtures(*(t.double() if t.is_floating_point() else t for t in empty._tensors()))
    clouds = clouds_of(blobs(3))
    assert empty.log_prob(clouds).tolist() == [-np.inf] * 3
    assert empty.assign(clouds).tolist() == [-1] * 3
    assert empty.responsibilities(clouds).sum() == 0
    assert empty.sample(5).sizes == (0,)


def test_no_points_give_no_values(mixtures):
    clouds = clouds_of(np.zeros((0, 3)), np.zeros((0, 3)))
    assert mixtures.log_prob(clouds).shape == (0,)
    assert mixtures.responsibilities(clouds).shape == (0, 4)
    assert mixtures.assign(clouds).shape == (0,)


def test_sampling_reproduces_the_moments(mixtures):
    clouds, component = mixtures.sample_components(100_000, seed=1)
    points, which = clouds.split(clouds.points)[0], clouds.split(component)[0]
    share = torch.bincount(which, minlength=4) / 100_000
    torch.testing.assert_close(share.double(), mixtures.weights[0], atol=0.01, rtol=0)
    for k in range(4):
        mine = points[which == k]
        torch.testing.assert_close(mine.mean(0), mixtures.means[0, k], atol=0.05, rtol=0)
        torch.testing.assert_close(torch.cov(mine.T), mixtures.covariances[0, k], atol=0.1, rtol=0.05)


def test_sampling_does_not_depend_on_the_place_in_the_batch(mixtures):
    together = mixtures.sample([50, 70], seed=3)
    assert together.sizes == (50, 70)
    assert torch.equal(together.split(together.points)[1], mixtures[1].sample(70, seed=3).points)
    assert not torch.equal(together.points, mixtures.sample([50, 70], seed=4).points)


def test_saving_and_loading(mixtures, tmp_path):
    path = tmp_path / "model.safetensors"
    mixtures.save(path)
    loaded = GaussianMixtures.load(path)
    for mine, theirs in zip(mixtures._tensors(), loaded._tensors(), strict=True):
        assert torch.equal(mine, theirs)


def test_damaged_files_are_refused(mixtures, tmp_path):
    path = tmp_path / "model.safetensors"
    with pytest.raises(SerializationError, match="does not exist"):
        GaussianMixtures.load(path)
    mixtures.save(path)
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(SerializationError, match="not a readable"):
        GaussianMixtures.load(path)
    import safetensors.torch

    safetensors.torch.save_file({"weights": torch.ones(1)}, path)
    with pytest.raises(SerializationError, match="expected gmmtorch"):
        GaussianMixtures.load(path)


@pytest.mark.parametrize("cells", [False, True])
def test_one_pass_gives_what_each_call_gives(mixtures, cells):
    spreads = [np.tile(0.01 * np.eye(3), (n, 1, 1)) for n in (300, 70)] if cells else None
    weights = [np.linspace(0.5, 2, n) for n in (300, 70)]
    clouds = clouds_of(room(300), room(70, 1), weights=weights, spreads=spreads)
    found = mixtures.posterior(clouds)
    assert torch.equal(found.log_prob, mixtures.log_prob(clouds))
    assert torch.equal(found.responsibilities, mixtures.responsibilities(clouds))
    assert torch.equal(found.components, mixtures.assign(clouds))
    claims = clouds.split(found.responsibilities * clouds.weights[:, None])
    torch.testing.assert_close(mixtures.expected_counts(clouds), torch.stack([c.sum(0) for c in claims]))


def test_thin_components_on_a_far_map_keep_their_digits():
    # A turned wall, 1 cm thick and 20 m long. Coordinates are rounded so that the shift itself loses nothing.
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    covariance = turn @ np.diag([1e-4, 25.0, 1.0]) @ turn.T
    points = np.round(np.random.default_rng(1).normal(size=(500, 3)) * [1e-2, 5, 1] @ turn.T * 2**20) / 2**20
    there = np.array([5e5, 4e6, 128.0])
    here, far = (
        GaussianMixtures.from_arrays([1.0], shift[None], covariance[None]).log_prob(clouds_of(points + shift))
        for shift in (np.zeros(3), there)
    )
    expected = multivariate_normal(np.zeros(3), covariance).logpdf(points)
    np.testing.assert_allclose(here.numpy(), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(far.numpy(), expected, rtol=1e-9, atol=1e-9)


def test_components_out_of_reach_claim_exactly_nothing():
    mixture = GaussianMixtures.from_arrays(
        [0.5, 0.5], [[0.0, 0, 0], [1e3, 0, 0]], np.stack([np.eye(3)] * 2)
    ).pad(3)
    clouds = clouds_of(np.zeros((4, 3)), spreads=None)
    assert mixture.responsibilities(clouds)[0].tolist() == [1.0, 0.0, 0.0]
    assert mixture.expected_counts(clouds)[0].tolist() == [4.0, 0.0, 0.0]


@pytest.mark.parametrize("chunk", [1, 40, 1000])
def test_how_points_are_cut_into_chunks_does_not_matter(mixtures, monkeypatch, chunk):
    clouds = clouds_of(room(300), room(70, 1))
    whole = mixtures.posterior(clouds)
    monkeypatch.setattr("gmmtorch.evaluation._CHUNK", chunk)
    pieces = mixtures.posterior(clouds)
    torch.testing.assert_close(pieces.log_prob, whole.log_prob, rtol=1e-12, atol=0)
    torch.testing.assert_close(pieces.responsibilities, whole.responsibilities, rtol=1e-10, atol=1e-14)
    torch.testing.assert_close(
        mixtures.expected_counts(clouds),
        whole.responsibilities.new_tensor(
            np.stack([r.sum(0).numpy() for r in clouds.split(whole.responsibilities)])
        ),
    )


def test_selecting_padding_and_trimming(mixtures):
    assert mixtures.batch_size == len(mixtures) == 2
    assert mixtures.num_slots == 4
    assert mixtures[1].trim().num_slots == 2
    picked = mixtures.select([1, 0, -1])
    assert picked.num_components.tolist() == [2, 4, 2]
    padded = mixtures.pad(6)
    assert torch.equal(padded.covariances[1, 5], torch.eye(3, dtype=torch.float64))
    assert padded.mask.sum(1).tolist() == [4, 2]
    assert [m.num_components.item() for m in mixtures] == [4, 2]
    with pytest.raises(ArgumentError):
        mixtures.pad(3)


def test_bad_mixtures_are_refused():
    weights, means, covariances = mixture_parameters(3, 3)
    with pytest.raises(ShapeError, match=r"\(B, K, D, D\)"):
        GaussianMixtures.from_arrays(weights, means, covariances[:2])
    with pytest.raises(ArgumentError, match="positive definite"):
        GaussianMixtures.from_arrays(weights, means, -covariances)
    with pytest.raises(ArgumentError, match="weights"):
        GaussianMixtures.from_arrays(-weights, means, covariances)
    with pytest.raises(ShapeError, match="one per mixture"):
        GaussianMixtures.from_arrays(weights, means, covariances).log_prob(clouds_of(room(3), room(3)))


def test_storing_and_padding_keep_every_bit(tmp_path):
    weights = torch.tensor([[0.1] * 10, [1 / 3, 1 / 3, 1 / 3, *[0.0] * 7]], dtype=torch.float64)
    means, covariances = torch.zeros(2, 10, 3).double(), torch.eye(3).double().expand(2, 10, 3, 3)
    mixtures = GaussianMixtures(weights, means, covariances, torch.tensor([10, 3]))
    mixtures.save(tmp_path / "mixtures.safetensors")
    assert torch.equal(GaussianMixtures.load(tmp_path / "mixtures.safetensors").weights, weights)
    assert torch.equal(mixtures.pad(12).weights[:, :10], weights)
    assert torch.equal(GaussianMixtures.from_list([mixtures, mixtures.pad(12)]).weights[2:, :10], weights)
