"""The parts that detectors share, against numpy and closed forms."""

import numpy as np
import pytest
import torch

from gmmtorch import GaussianMixtures
from gmmtorch.distances import covariance_distance
from novelty import Scan, ScanPair
from novelty.detectors.quantiles import weighted_quantiles
from novelty.detectors.resolution import blurred, cell_resolution
from novelty.detectors.scaled_graphs import build_scaled_graphs, scaled_mean_distance
from novelty.matching import Components
from novelty.preprocess import Preprocess, prepare_pairs


@pytest.mark.parametrize("level", [0.0, 0.01, 0.25, 0.5, 0.99, 1.0])
def test_quantiles_of_groups_equal_numpy(rng, level):
    values, groups = rng.normal(size=300), rng.integers(0, 5, 300)
    repeats = rng.integers(1, 4, 300)
    found = weighted_quantiles(
        torch.from_numpy(values), torch.from_numpy(repeats).double(), torch.from_numpy(groups), 6, level
    )
    for g in range(5):
        repeated = np.repeat(values[groups == g], repeats[groups == g])
        assert found[g] == np.quantile(repeated, level, method="inverted_cdf")
    assert found[5].isnan()


def test_quantiles_pass_over_values_without_weight_or_group():
    values = torch.tensor([5.0, 1.0, 2.0, 3.0, -9.0], dtype=torch.float64)
    weights = torch.tensor([0.0, 1.0, 1.0, 1.0, 1.0], dtype=torch.float64)
    groups = torch.tensor([0, 0, 0, 0, -1])
    assert weighted_quantiles(values, weights, groups, 1, 1.0).tolist() == [3.0]
    assert weighted_quantiles(values[:0], weights[:0], groups[:0], 2, 0.5).isnan().all()


def mixtures(rng, count: int) -> GaussianMixtures:
    root = rng.normal(size=(1, count, 3, 3))
    return GaussianMixtures.from_arrays(
        np.full((1, count), 1 / count),
        rng.normal(size=(1, count, 3)),
        root @ root.swapaxes(2, 3) + 0.1 * np.eye(3),
    )


def test_blurring_adds_a_variance_per_pair():
    covariances = torch.zeros(2, 1, 3, 3, dtype=torch.float64)
    found = blurred(covariances, torch.tensor([0.1, 2.0]))
    torch.testing.assert_close(found[:, 0, 0, 0], torch.tensor([0.01, 4.0], dtype=torch.float64))
    assert (found[:, 0, 0, 1] == 0).all()


def test_what_misalignment_remains_is_part_of_every_resolution(rng):
    scans = [Scan(rng.normal(size=(300, 3))) for _ in range(2)]
    batch = prepare_pairs([ScanPair(*scans)] * 3, Preprocess(outliers="none", ground="none"))
    still = torch.eye(4, dtype=torch.float64).expand(3, 4, 4)
    aligned = batch.aligned(still, torch.tensor([0.0, torch.nan, 0.3], dtype=torch.float64))
    for length in (cell_resolution, lambda pairs: pairs.resolution):
        before, after = length(batch), length(aligned)
        assert torch.equal(after[:2], before[:2])  # none, and not known
        torch.testing.assert_close(after[2] ** 2, before[2] ** 2 + 0.09)
        assert torch.equal(length(aligned.exchanged()), after)
    assert torch.equal(aligned.sampling, batch.sampling)


def components(m: GaussianMixtures) -> Components:
    return Components(m.weights, m.means, m.covariances)


@pytest.mark.parametrize(("terms", "power"), [("squared", 2), ("plain", 1)])
def test_scaled_graphs_hold_for_every_pair_of_nodes(rng, terms, power):
    a, b = mixtures(rng, 4), mixtures(rng, 5)
    graphs = build_scaled_graphs(components(a), components(b), 6.0, 1.0, terms)
    inner = []
    for side in (components(a), components(b)):
        inner.append(
            (scaled_mean_distance(side, side)[0], covariance_distance(side.covariances, side.covariances)[0])
        )
    num_nodes = int(graphs.num_nodes[0])
    assert num_nodes == int((graphs.table < 6.0).sum()) > 5
    for x in range(num_nodes):
        for y in range(num_nodes):
            i, j = (int(graphs.nodes_a[0, n]) for n in (x, y))
            k, m = (int(graphs.nodes_b[0, n]) for n in (x, y))
            expected = i != j and k != m
            for of_a, of_b in zip(*inner, strict=True):
                first, second = float(of_a[i, j]) ** power, float(of_b[k, m]) ** power
                expected &= abs(first - second) <= 1 + (first + second) / 2
            assert bool(graphs.adjacency[0, x, y]) == expected


def test_scaled_mean_distance_has_no_unit(rng):
    a, b = components(mixtures(rng, 3)), components(mixtures(rng, 2))
    tall = [Components(c.weights, 1000 * c.means, 1e6 * c.covariances) for c in (a, b)]
    torch.testing.assert_close(scaled_mean_distance(*tall), scaled_mean_distance(a, b))
