import numpy as np
import pytest
import torch

from gmmtorch import PointClouds
from novelty.baselines import FuzzyPartitions, fit_fuzzy_partitions
from novelty.baselines.clustered import clustered_mixtures
from novelty.baselines.fuzzy_clustering import FAR, alpha_cut, kmeans_memberships, validity_measures
from tests.helpers import blobs
from tests.reference import fuzzy


def separated(num_clusters, per_cluster=60, seed=0):
    """Round clusters of standard deviation 0.1 at distances of at least 2 (N, 3), and the cluster of each point."""
    rng = np.random.default_rng(seed)
    centres = 2.0 * np.array([(k % 2, (k // 2) % 2, k // 4) for k in range(num_clusters)], dtype=float)
    truth = np.repeat(np.arange(num_clusters), per_cluster)
    return centres[truth] + rng.normal(0, 0.1, (len(truth), 3)), truth


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_the_loops_at_every_number_of_clusters(seed):
    points = blobs(80, num_components=3, seed=seed)
    found = fit_fuzzy_partitions(PointClouds.from_list([points]), 4, tolerance=1e-3, max_iterations=30)
    expected = fuzzy.partition(points, 4, FAR, 1e-3, 30)
    for k, memberships in enumerate(expected):
        clusters = found.mixtures[k]
        prototypes = fuzzy.prototypes_of(points, memberships)
        np.testing.assert_allclose(clusters.weights[0], memberships.mean(0), atol=1e-5)
        np.testing.assert_allclose(clusters.means[0], prototypes, atol=1e-4)
        covariances = fuzzy.covariances_of(points, memberships, prototypes)
        np.testing.assert_allclose(clusters.covariances[0], covariances, atol=2e-4)
        measures = [
            values[0, k].item() for values in (found.hypervolume, found.average_density, found.density)
        ]
        np.testing.assert_allclose(measures, fuzzy.validity(points, memberships), rtol=2e-3)


def test_memberships_of_kmeans_equal_the_loops(rng):
    points, prototypes = rng.normal(size=(40, 3)), rng.normal(size=(5, 3))
    found = kmeans_memberships(PointClouds.from_list([points]), torch.from_numpy(prototypes)[None])
    np.testing.assert_allclose(found, fuzzy.kmeans_memberships(points, prototypes), rtol=1e-12)


def test_the_exponential_distance_is_the_posterior_of_a_mixture(rng):
    points, memberships = rng.normal(size=(60, 3)), rng.dirichlet(np.ones(4), 60)
    clusters = clustered_mixtures(PointClouds.from_list([points]), torch.from_numpy(memberships), 2.0)
    found = clusters.responsibilities(PointClouds.from_list([points]))
    np.testing.assert_allclose(found, fuzzy.maximum_likelihood_step(points, memberships), rtol=1e-6)


def test_the_validity_measures_are_those_that_were_published(rng):
    points, memberships = rng.normal(size=(70, 3)), rng.dirichlet(np.ones(3), 70)
    clouds = PointClouds.from_list([points])
    clusters = clustered_mixtures(clouds, torch.from_numpy(memberships), 2.0)
    found = validity_measures(clouds, clusters, torch.from_numpy(memberships))
    np.testing.assert_allclose([v.item() for v in found], fuzzy.validity(points, memberships), rtol=1e-6)


def test_one_cluster_has_the_volume_and_the_density_of_a_gaussian():
    points = np.random.default_rng(0).normal(size=(20_000, 3)) * (1.0, 2.0, 3.0)
    found = fit_fuzzy_partitions(PointClouds.from_list([points]), 1)
    # sqrt(det) = 6; within one standard deviation lie 19.87 % of the points of three dimensions.
    assert found.hypervolume.item() == pytest.approx(6.0, rel=0.02)
    assert found.density.item() == pytest.approx(0.1987 * 20_000 / 6.0, rel=0.03)
    assert found.average_density.item() == pytest.approx(found.density.item())


@pytest.mark.parametrize("num_clusters", [2, 3, 4])
def test_finds_the_number_of_separated_clusters(num_clusters):
    points, truth = separated(num_clusters, 200)
    clouds = PointClouds.from_list([points])
    found = fit_fuzzy_partitions(clouds, 6)
    orders = found.best("average_density")
    assert orders == [num_clusters]
    # The hypervolume falls until every cluster has its own, and hardly afterwards.
    volumes = found.hypervolume[0]
    assert volumes[num_clusters - 1] < 0.55 * volumes[num_clusters - 2]
    assert volumes[num_clusters:].min() > 0.9 * volumes[num_clusters - 1]
    labels = alpha_cut(found.taken(orders).responsibilities(clouds)).numpy()
    pairs = set(zip(truth.tolist(), labels.tolist(), strict=True))
    assert len(pairs) == num_clusters, "every cluster is one of the partition's"


@pytest.mark.parametrize(("validity", "order"), [("hypervolume", 3), ("average_density", 2), ("density", 1)])
def test_the_least_volume_and_the_greatest_density_are_the_best(validity, order):
    measures = (
        torch.tensor([[3.0, 2.0, 1.0]]),
        torch.tensor([[1.0, 2.0, 1.0]]),
        torch.tensor([[2.0, 2.0, 1.0]]),
    )
    assert FuzzyPartitions((), *measures, torch.zeros(1, 3)).best(validity) == [order]


def test_a_batch_equals_its_clouds_alone():
    clouds = [blobs(90, seed=0), blobs(40, seed=1), separated(3)[0]]
    together = fit_fuzzy_partitions(PointClouds.from_list(clouds), 4)
    for b, points in enumerate(clouds):
        alone = fit_fuzzy_partitions(PointClouds.from_list([points]), 4)
        np.testing.assert_allclose(together.density[b], alone.density[0], rtol=1e-9)
        np.testing.assert_array_equal(together.num_iterations[b], alone.num_iterations[0])
        np.testing.assert_allclose(together.mixtures[3].means[b], alone.mixtures[3].means[0], atol=1e-9)


def test_maps_far_from_the_origin_are_cut_alike():
    points = blobs(200, seed=3)
    near = fit_fuzzy_partitions(PointClouds.from_list([points]), 3)
    far = fit_fuzzy_partitions(PointClouds.from_list([points + 5e5]), 3)
    np.testing.assert_allclose(near.mixtures[2].means + 5e5, far.mixtures[2].means, atol=1e-3)


@pytest.mark.parametrize(
    "points", [np.zeros((30, 3)), np.column_stack([np.arange(40.0), *np.zeros((2, 40))]), np.zeros((0, 3))]
)
def test_degenerate_clouds_leave_no_nan(points):
    others = blobs(50)
    found = fit_fuzzy_partitions(PointClouds.from_list([points, others]), 3)
    for clusters in found.mixtures:
        assert torch.isfinite(clusters.means).all()
        assert torch.isfinite(clusters.covariances).all()
    assert torch.isfinite(found.density).all()


def test_the_alpha_cut_leaves_points_without_a_cluster():
    memberships = torch.tensor([[0.15] * 6 + [0.1], [0.9, *[0.1 / 6] * 6], [0.25, 0.75, 0, 0, 0, 0, 0]])
    assert alpha_cut(memberships, 0.2).tolist() == [-1, 0, 1]
    assert alpha_cut(memberships, 0.95).tolist() == [-1, -1, -1]
