"""Distance from the surface another scan measured, and labels refined by it."""

import dataclasses

import numpy as np
import pytest
import torch

import novelty
from gmmtorch import PointClouds
from novelty import Config
from novelty.preprocess import Preprocess, prepare
from novelty.refinement import own_distances, surface_distances
from novelty.refinement.chance import chance_group_sizes
from novelty.scan import Scan
from novelty.simulation import room_pair, simulate_pair

SPACING, NOISE = 0.02, 0.004


def wall(seed: int, hole: bool = False) -> np.ndarray:
    rng = np.random.default_rng(seed)
    y, z = np.meshgrid(np.arange(-1, 1, SPACING), np.arange(0, 2, SPACING))
    points = np.stack([2 + NOISE * rng.normal(size=y.size), y.ravel(), z.ravel()], axis=1)
    outside = np.abs(points[:, 1]) + np.abs(points[:, 2] - 1) > 0.4
    return points[outside] if hole else points


def prepared(points: np.ndarray):
    return prepare([Scan(points)], Preprocess(outliers="none", ground="none"))


def naive(points: np.ndarray, cells: PointClouds, resolution: float) -> np.ndarray:
    """The least squared Mahalanobis distance over all cells."""
    best = np.full(len(points), np.inf)
    for mean, spread in zip(cells.points.numpy(), cells.spreads.numpy(), strict=True):
        offset = points - mean
        information = np.linalg.inv(spread + resolution**2 * np.eye(3))
        best = np.minimum(best, np.einsum("ni,ij,nj->n", offset, information, offset))
    return best


def test_distances_are_those_of_the_nearest_cell():
    scan = prepared(wall(1))
    queries = wall(2)[::40] + np.array([[0.02, 0, 0]])
    found = surface_distances(PointClouds.from_list([queries]), scan.cells, torch.tensor([SPACING]))
    np.testing.assert_allclose(found.numpy(), naive(queries, scan.cells, SPACING), rtol=1e-6)


def test_another_measurement_of_the_wall_is_on_it_and_an_offset_one_is_off():
    scan, again = prepared(wall(1)), PointClouds.from_list([wall(2)])
    resolution = torch.tensor([SPACING])
    assert (surface_distances(again, scan.cells, resolution) > 16.3).double().mean() < 1e-3
    away = PointClouds.from_list([wall(2) + np.array([0.12, 0, 0])])
    assert (surface_distances(away, scan.cells, resolution) > 16.3).double().mean() > 0.99


def test_a_hole_that_was_filled_is_off_the_surface():
    scan = prepared(wall(1, hole=True))
    points = wall(2)
    inside = np.abs(points[:, 1]) + np.abs(points[:, 2] - 1) < 0.25
    distances = surface_distances(
        PointClouds.from_list([points]), scan.cells, torch.tensor([SPACING])
    ).numpy()
    assert (distances[inside] > 16.3).mean() > 0.9
    assert (distances[~inside][::7] > 16.3).mean() < 0.1


def test_far_from_the_origin_distances_are_the_same():
    shift = torch.tensor([5e5, 4e6, 100.0], dtype=torch.float64)
    cells, points = prepared(wall(1)).cells, PointClouds.from_list([wall(2)])
    resolution = torch.tensor([SPACING])
    near = surface_distances(points, cells, resolution)
    moved = [dataclasses.replace(clouds, points=clouds.points + shift) for clouds in (points, cells)]
    torch.testing.assert_close(surface_distances(*moved, resolution), near, rtol=1e-5, atol=1e-5)


def test_an_empty_other_scan_is_infinitely_far():
    empty = PointClouds.from_list([np.zeros((0, 3))])
    assert torch.isinf(surface_distances(PointClouds.from_list([wall(1)]), empty, torch.tensor([0.1]))).all()


@pytest.mark.parametrize(("share", "within"), [(0.5, 0.15), (0.9, 0.08), (0.99, 0.02)])
def test_a_scans_own_distances_follow_the_share_asked_for(share, within):
    """Cells of three quarters of the points are a little smaller, so that the distances are a little larger."""
    scan = prepared(wall(3))
    (own,) = own_distances(scan.points, scan.cell_of_point, torch.tensor([SPACING]))
    quantile = float(own.quantile(share))
    again = surface_distances(PointClouds.from_list([wall(4)]), scan.cells, torch.tensor([SPACING]))
    assert abs(float((again <= quantile).double().mean()) - share) < within


def test_refinement_finds_what_shares_a_component_with_a_wall():
    pair = room_pair(seed=109, changes=("box",), density=0.3, object_size=0.3)
    truth, ignore = pair.current.labels == 1, pair.current.labels >= 2
    shared = Config(max_components=4).replace(**{"fit.unexplained_components": 0})
    coarse = shared.replace(**{"refine.method": "none"})
    refined = novelty.detect(pair, shared)
    assert novelty.evaluate(truth, refined.added.point_labels, ignore).kappa > 0.7
    plain = novelty.detect(pair, coarse)
    assert not novelty.evaluate(truth, plain.added.point_labels, ignore).kappa > 0.5


@pytest.mark.parametrize("shift", [0.0, 1.5])
def test_p_values_of_unchanged_points_keep_their_level(shift):
    """Seen twice, from one place and from another: as rare as they claim, and not much rarer than they need be."""
    scans = simulate_pair("room", 4, (), noise=0.01, density=0.4, viewpoint_shift=shift).scans
    added = novelty.detect(novelty.ScanPair(scans.reference, scans.current)).added
    p_values = added.point_p_values[(scans.current.labels == 0) & np.isfinite(added.point_p_values)]
    for level in (0.5, 0.1, 0.05):
        assert level / 10 < (p_values <= level).mean() < 1.2 * level


def test_a_stray_cell_vouches_for_nothing():
    """Three returns far apart in one cell would cover the thing that stands between them."""
    surface = prepared(wall(1)).cells
    stray_spread = torch.diag(torch.tensor([0.0, 0.1, 0.1], dtype=torch.float64))[None]
    cells = PointClouds.from_list(
        [torch.cat([surface.points, torch.tensor([[1.5, 0.0, 1.0]], dtype=torch.float64)])],
        weights=[torch.cat([surface.weights, torch.tensor([3.0], dtype=torch.float64)])],
        spreads=[torch.cat([surface.spreads, stray_spread])],
    )
    thing = PointClouds.from_list([np.array([[1.5, 0.1, 1.1]])])
    assert float(surface_distances(thing, cells, torch.tensor([SPACING]))) > 100


def test_where_no_ray_can_tell_a_scan_says_how_large_groups_of_chance_are():
    rng = np.random.default_rng(0)
    foliage = np.array([0.0, 0.0, 1.0]) + 0.3 * rng.normal(size=(600, 3))
    smooth, rough = prepared(wall(3)), prepared(np.concatenate([wall(3), foliage]))
    threshold, resolution = torch.tensor([16.0]), torch.tensor([SPACING])
    (none,) = chance_group_sizes(smooth, resolution, threshold, [True])
    (some,) = chance_group_sizes(rough, resolution, threshold, [True])
    assert none < 20 < some
    assert chance_group_sizes(rough, resolution, threshold, [False]).tolist() == [0]
