"""Fewer points and cells of an octree, and order searches that begin on them."""

import numpy as np
import pytest
import torch

from gmmtorch import ArgumentError, PointClouds, coarsen, description_length, fit_em, fit_mdl
from gmmtorch.coarsening import thin
from tests.helpers import blobs, hostile_clouds, room


@pytest.mark.parametrize("dim", [1, 2, 3, 7])
@pytest.mark.parametrize("most", [1, 5, 40])
def test_cells_hold_all_points_and_no_more_than_asked_for(dim, most):
    points = blobs(500, dim, seed=dim)
    cells = coarsen(PointClouds.from_list([points]), most)
    assert float(cells.weights.max()) <= most
    assert float(cells.weights.sum()) == 500
    mean = (cells.weights[:, None] * cells.points).sum(0) / 500
    np.testing.assert_allclose(mean, points.mean(0), atol=1e-12)
    away = cells.points - mean
    second = cells.spreads + away[:, :, None] * away[:, None, :]
    covariance = (cells.weights[:, None, None] * second).sum(0) / 500
    np.testing.assert_allclose(covariance, np.atleast_2d(np.cov(points.T, bias=True)), atol=1e-12)
    if most == 1:
        torch.testing.assert_close(cells.points, torch.from_numpy(points))


def test_cells_of_a_scan_at_map_coordinates_are_compact():
    points = room(20_000) + np.array([5e5, 4e6, 100.0])
    cells = coarsen(PointClouds.from_list([points]), 16)
    here = coarsen(PointClouds.from_list([room(20_000)]), 16)
    assert cells.sizes[0] == pytest.approx(here.sizes[0], rel=0.01)
    assert 20_000 / 16 < cells.sizes[0] < 20_000 / 4
    widest = torch.linalg.eigvalsh(cells.spreads)[:, -1].sqrt()
    assert float(widest.median()) < 0.1


def test_weights_and_spreads_are_passed_on():
    points, weights = np.repeat([[0.0, 0, 0], [9.0, 9, 9]], 3, 0), [np.array([1.0, 2, 3, 0, 0, 0])]
    clouds = PointClouds.from_list([points], weights, [np.tile(np.eye(3), (6, 1, 1))])
    cells = coarsen(clouds, 4)
    assert cells.weights.tolist() == [6.0, 0.0]
    torch.testing.assert_close(cells.points, torch.tensor([[0.0, 0, 0], [9.0, 9, 9]], dtype=torch.float64))
    torch.testing.assert_close(cells.spreads, torch.eye(3).double().expand(2, 3, 3))


def test_a_batch_is_its_members_and_identical_points_are_one_cell():
    clouds = PointClouds.from_list([room(700), np.zeros((0, 3)), np.ones((90, 3)), blobs(300)])
    together = coarsen(clouds, 10)
    for b in range(4):
        alone = coarsen(clouds[b], 10)
        assert torch.equal(together[b].points, alone.points)
        assert torch.equal(together[b].spreads, alone.spreads)
    assert together.sizes[1:3] == (0, 1)
    with pytest.raises(ArgumentError, match="max_points"):
        coarsen(clouds, 0)


@pytest.mark.parametrize("by", ["points", "cells"])
def test_a_coarse_search_is_polished_on_all_points(by):
    clouds = PointClouds.from_list([room(20_000), room(5_000, 1)])
    coarse, full = fit_mdl(clouds, 12, coarse=8, coarse_by=by), fit_mdl(clouds, 12)
    torch.testing.assert_close(coarse.mdl, description_length(coarse.mixtures, clouds), rtol=1e-9, atol=0)
    again = fit_em(clouds, initial=coarse.mixtures, max_iterations=1, tolerance=None)
    assert (
        again.log_likelihood - coarse.log_likelihood < 1.2
    ).all()  # a step of EM gains no more than its rule
    assert ((coarse.mdl - full.mdl) / torch.tensor([20_000, 5_000]) < 0.05).all()
    chosen = coarse.mdl_path[torch.arange(2), coarse.mixtures.num_components - 1]
    assert torch.equal(chosen, coarse.mdl)


def test_a_thinned_cloud_is_spread_as_evenly_and_weighs_as_much():
    rng = np.random.default_rng(0)
    points = [rng.uniform(-1, 1, (40_000, 3)), rng.normal(size=(2_500, 3)), np.zeros((0, 3))]
    clouds = PointClouds.from_list(points, [np.arange(len(x)) + 1.0 for x in points])
    fewer = thin(clouds, 10)
    assert fewer.sizes == (4_000, 2_500, 0)
    torch.testing.assert_close(fewer.total_weights, clouds.total_weights)
    corners = (fewer[0].points > 0).long() @ torch.tensor([1, 2, 4])
    assert (torch.bincount(corners) - 500).abs().max() < 30  # 21 would be the deviation of a random choice
    rows = [(clouds[0].points == p).all(1).nonzero().item() for p in fewer[0].points[::500]]
    assert rows == sorted(rows)
    for b in range(3):
        assert torch.equal(thin(clouds[b], 10).points, fewer[b].points)
    with pytest.raises(ArgumentError, match="stride"):
        thin(clouds, 0)


@pytest.mark.parametrize("by", ["points", "cells"])
def test_a_coarse_search_survives_what_the_full_one_does(by):
    clouds = PointClouds.from_list(list(hostile_clouds().values()))
    coarse, full = fit_mdl(clouds, 6, coarse=4, coarse_by=by), fit_mdl(clouds, 6)
    assert coarse.mdl.isfinite().all()
    assert torch.equal(coarse.mixtures.num_components > 0, full.mixtures.num_components > 0)
    repeated = fit_mdl(clouds, [3, 6], coarse=4, coarse_by=by, members=[1, 1])
    assert torch.equal(repeated.mdl[1:], coarse.mdl[1:2])
