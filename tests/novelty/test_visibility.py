"""What another scan could see, on a wall looked at from one place."""

import dataclasses

import numpy as np
import pytest
import torch

import novelty
from gmmtorch import PointClouds
from novelty import Config, Scan, ScanPair
from novelty.preprocess import PreparedScans, Preprocess, prepare
from novelty.refinement import surface_distances
from novelty.simulation import room_pair
from novelty.visibility import Rays, Sight
from novelty.visibility.patches import filled_between_lines, patch_normals

ORIGIN = np.array([10.0, -5.0, 1.0])


@pytest.fixture(scope="module")
def rays() -> Rays:
    """A wall 3 m ahead of the sensor, 40 degrees wide."""
    azimuth, elevation = np.meshgrid(
        np.radians(np.linspace(-20, 20, 161)), np.radians(np.linspace(-20, 20, 161))
    )
    ray = np.stack([np.ones_like(azimuth), np.tan(azimuth), np.tan(elevation)], axis=-1).reshape(-1, 3)
    return Rays.of(ORIGIN + 3.0 * ray, ORIGIN)


def test_a_point_before_the_wall_was_seen_through_one_behind_it_hidden_one_on_it_is_surface(rays):
    places = ORIGIN + np.array(
        [[2.0, 0.1, 0.2], [4.0, 0.1, 0.2], [3.0, 0.1, 0.2], [-2.0, 0.0, 0.0], [0.1, 3.0, 0.0]]
    )
    expected = [Sight.SEEN_THROUGH, Sight.HIDDEN, Sight.SURFACE, Sight.NO_RAY, Sight.NO_RAY]
    assert rays.sights(places, tolerance=0.05).tolist() == expected


def test_a_difference_within_the_tolerance_means_nothing(rays):
    place = ORIGIN + np.array([[2.9, 0.0, 0.0]])
    assert rays.sights(place, tolerance=0.05)[0] == Sight.SEEN_THROUGH
    assert rays.sights(place, tolerance=0.2)[0] == Sight.SURFACE


def test_an_edge_brackets_what_lies_between():
    y, z = np.meshgrid(np.linspace(-0.5, 0.5, 201), np.linspace(-0.5, 0.5, 201))
    x = np.where(y < 0, 2.0, 3.0)
    rays = Rays.of(np.stack([x, y * x, z * x], axis=-1).reshape(-1, 3), np.zeros(3))
    assert rays.sights(np.array([[2.5, 0.0, 0.0]]), tolerance=0.05)[0] == Sight.SURFACE


def test_with_its_slope_known_a_point_at_an_edge_was_missed_and_a_slanted_surface_was_met():
    """Rays of half a degree: a floor 1 m below ends them 8.2 to 12 m away, and an edge at y = 0 at 2 m or 9 m."""
    elevation, azimuth = np.meshgrid(
        np.radians(np.arange(-7, -4.7, 0.5)), np.radians(np.arange(-6, 6.1, 0.5))
    )
    ray = np.stack([np.cos(azimuth), np.sin(azimuth), np.tan(elevation)], axis=-1).reshape(-1, 3)
    floor = Rays.of(ray / -ray[:, 2:], np.zeros(3))
    up, ahead = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    place = np.array([[10.0, 0.0, -1.0]])
    assert floor.sights(place, 0.05, up)[0] == Sight.SURFACE  # a little before it and a little behind it
    wall = ray * np.where(np.degrees(azimuth.reshape(-1, 1)) > -0.3, 9.0, 2.0)
    edge = Rays.of(wall, np.zeros(3))
    between = np.array([[5.0, 0.0, -0.52]])
    assert edge.sights(between, 0.05)[0] == Sight.SURFACE
    assert edge.sights(between, 0.05, ahead)[0] == Sight.BESIDE
    assert edge.sights(between - [0.0, 0.06, 0.0], 0.05, ahead)[0] == Sight.HIDDEN
    assert edge.sights(np.array([[5.0, 0.3, -0.52]]), 0.05, ahead)[0] == Sight.SEEN_THROUGH
    assert edge.sights(np.array([[5.0, 0.3, -0.52]]), 0.05, up)[0] == Sight.BESIDE  # edge on


def spinning(turns, azimuths, same):
    """A wall 3 m ahead seen by 16 lines 2 degrees apart, (N, 3); turns begin anywhere, or all at one azimuth."""
    elevations = np.radians(np.linspace(-15, 15, 16))
    starts = np.zeros(turns) if same else np.random.default_rng(0).random(turns)
    azimuth = np.radians(
        np.concatenate([(np.arange(azimuths) + start) * 40 / azimuths - 20 for start in starts])
    )
    azimuth, elevation = np.meshgrid(azimuth, elevations)
    return 3.0 * np.stack([np.ones_like(azimuth), np.tan(azimuth), np.tan(elevation)], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize(
    ("turns", "azimuths", "same"), [(1, 200, True), (1, 800, True), (10, 100, False), (10, 100, True)]
)
def test_a_lidar_of_few_lines_sees_between_them_however_long_it_stood_still(turns, azimuths, same):
    rays = Rays.of(spinning(turns, azimuths, same), np.zeros(3))
    on_line, between = np.radians(1.0), np.radians(2.0)
    places = 2.0 * np.array([[1.0, np.tan(0.013), np.tan(angle)] for angle in (on_line, between)])
    facing = np.array([[1.0, 0.0, 0.0]] * 2)
    assert rays.sights(places, 0.05, facing).tolist() == [Sight.SEEN_THROUGH] * 2
    assert rays.sights(2 * places, 0.05, facing).tolist() == [Sight.HIDDEN] * 2
    assert rays.sights(1.5 * places, 0.05, facing).tolist() == [Sight.SURFACE] * 2
    assert rays.sights(np.array([[0.0, 2.0, 0.0]]), 0.05)[0] == Sight.NO_RAY


@pytest.mark.parametrize(("turns", "azimuths"), [(1, 100), (1, 1200), (10, 200)])
def test_pieces_of_single_scan_lines_face_as_the_wall_does(turns, azimuths):
    points = spinning(turns, azimuths, same=False)
    points *= 1 + np.random.default_rng(1).normal(0, 0.003, (len(points), 1))
    scans = prepare([Scan(points, origin=np.zeros(3))], Preprocess(ground="none", outliers="none"))
    normals = patch_normals(scans, torch.ones(len(scans.cells.points), dtype=torch.bool))
    known = ~normals[:, 0].isnan()
    assert known.double().mean() > 0.9
    assert (normals[known, 0].abs() > 0.8).double().mean() > 0.9


def test_a_ray_on_one_side_of_a_point_between_lines_does_not_clear_it():
    """Lines 2 degrees apart; those above the horizon see a wall at 6 m over the top of a thing 3 m away."""
    ray = spinning(1, 400, same=True) / 3.0
    rays = Rays.of(ray * np.where(ray[:, 2:] > 0, 6.0, 3.0), np.zeros(3))
    facing = np.array([[1.0, 0.0, 0.0]])
    for degrees, sight in ((1.0, Sight.SEEN_THROUGH), (0.85, Sight.BESIDE), (3.85, Sight.SEEN_THROUGH)):
        place = 3.0 * np.array([[1.0, np.tan(0.0135), np.tan(np.radians(degrees))]])
        assert rays.sights(place, 0.05, facing)[0] == sight, degrees


def test_a_thing_on_a_single_line_is_cleared_by_rays_through_it_only():
    rays = Rays.of(spinning(1, 800, same=True), np.zeros(3))
    bar = 2.0 * np.array([[1.0, np.tan(0.0135), np.tan(np.radians(angle))] for angle in (1.0, 1.1)])
    of_a_line, unknown = np.zeros((2, 3)), None
    assert rays.sights(bar, 0.05, of_a_line).tolist() == [Sight.SEEN_THROUGH, Sight.BESIDE]
    assert rays.sights(bar, 0.05, unknown).tolist() == [Sight.SEEN_THROUGH] * 2


def test_rays_that_all_pass_at_one_side_do_not_clear_a_point():
    """Rays a quarter of a degree apart to a wall 3 m ahead; none returned from azimuths below 10 degrees."""
    tangents = np.tan(np.radians(np.linspace(-20, 20, 161)))
    ray = np.stack([np.ones((161, 161)), *np.meshgrid(tangents, tangents)], axis=-1).reshape(-1, 3)
    rays = Rays.of(3.0 * ray[ray[:, 1] > np.tan(np.radians(10.1))], np.zeros(3))
    facing = np.array([[1.0, 0.0, 0.0]])
    for degrees, sight in ((9.0, Sight.NO_RAY), (10.05, Sight.BESIDE), (10.6, Sight.SEEN_THROUGH)):
        place = 2.0 * np.array([[1.0, np.tan(np.radians(degrees)), np.tan(np.radians(0.125))]])
        assert rays.sights(place, 0.05, facing)[0] == sight, degrees


def scanned(points) -> PreparedScans:
    points = points * (1 + np.random.default_rng(1).normal(0, 0.003, (len(points), 1)))
    return prepare([Scan(points, origin=np.zeros(3))], Preprocess(ground="none", outliers="none"))


def test_a_bar_on_a_single_line_has_no_normal_and_a_sheet_along_the_rays_is_edge_on():
    wall = spinning(1, 800, same=True)
    y = np.linspace(-0.2, 0.2, 150)
    bar = np.stack([np.full_like(y, 1.5), y, np.full_like(y, 0.02)], axis=1)
    x, z = (part.ravel() for part in np.meshgrid(np.linspace(1.0, 1.4, 30), np.linspace(-0.2, 0.2, 30)))
    sheet = np.stack([x, 0.35 * x, z], axis=1)
    scans = scanned(np.concatenate([wall, bar, sheet]))
    normals = patch_normals(scans, torch.ones(len(scans.cells.points), dtype=torch.bool))
    x = scans.cells.points[:, 0]
    assert (normals[(x > 1.45) & (x < 1.55)] == 0).all()
    of_sheet = (x > 1.1) & (x < 1.3) & (scans.cells.weights > 3)
    assert (normals[of_sheet] @ torch.tensor([0.35, -1.0, 0.0], dtype=torch.float64)).abs().median() > 0.9


def test_between_its_lines_a_wall_goes_on_and_not_far_past_its_edge():
    scans = scanned(spinning(1, 800, same=True))
    cells, filled = scans.cells, filled_between_lines(scans)
    degrees = np.array([2.0, 4.0, 15.0 + 1.0, 15.0 + 4.0])  # between lines, and past the last one
    places = 3.0 * np.array([[1.0, np.tan(0.05), np.tan(np.radians(angle))] for angle in degrees])
    before = places - [0.2, 0.0, 0.0]
    asked = PointClouds.from_list([np.concatenate([places, before])])
    resolution = torch.tensor([0.01], dtype=torch.float64)
    far = surface_distances(asked, cells, resolution).sqrt()
    near = surface_distances(asked, filled, resolution).sqrt()
    assert far[[0, 1, 2]].min() > 4
    assert near[[0, 1, 2]].max() < 3
    assert near[3:].min() > 4
    assert torch.equal(filled.points, cells.points)
    assert torch.equal(filled.weights, cells.weights)


def test_a_wall_sampled_evenly_and_a_scan_from_nowhere_are_as_they_were():
    y, z = (part.ravel() for part in np.meshgrid(np.linspace(-1, 1, 100), np.linspace(-1, 1, 100)))
    even = scanned(np.stack([np.full_like(y, 3.0), y, z], axis=1))
    wider = (filled_between_lines(even).spreads - even.cells.spreads).diagonal(dim1=1, dim2=2).sum(dim=1)
    assert (wider > 0).double().mean() < 0.05  # strips at its border
    assert wider.max() < even.cell_size.square()
    lines = prepare([Scan(spinning(1, 800, same=True))], Preprocess(ground="none", outliers="none"))
    assert torch.equal(filled_between_lines(lines).spreads, lines.cells.spreads)


def test_no_points_and_no_rays_give_no_sight(rays):
    assert rays.sights(np.zeros((0, 3)), 0.1).shape == (0,)
    assert Rays.of(np.zeros((0, 3)), ORIGIN).sights(np.ones((4, 3)), 0.1).tolist() == [Sight.NO_RAY] * 4


@pytest.fixture(scope="module")
def moved_viewpoint() -> ScanPair:
    return room_pair(seed=108, density=0.3, viewpoint_shift=1.5)


@pytest.fixture(scope="module")
def result(moved_viewpoint) -> novelty.NoveltyResult:
    return novelty.detect(moved_viewpoint)


def test_surfaces_that_only_the_moved_sensor_sees_are_not_novel(moved_viewpoint, result):
    for scan, change in (
        (moved_viewpoint.current, result.added),
        (moved_viewpoint.reference, result.removed),
    ):
        once = scan.labels == 2
        assert once.sum() > 100
        assert change.point_labels[once].mean() < 0.1
        assert change.point_labels[scan.labels == 0].mean() < 0.003
    assert (
        np.isin(result.added.point_states, (2, 3)).sum() + np.isin(result.removed.point_states, (2, 3)).sum()
        > 100
    )


def test_without_visibility_they_are(moved_viewpoint):
    blind = Config().replace(**{"visibility.method": "none"})
    result = novelty.detect(moved_viewpoint, blind)
    assert result.removed.point_labels[moved_viewpoint.reference.labels == 2].mean() > 0.2


def test_several_stations_see_more_than_one(moved_viewpoint, result):
    scan = moved_viewpoint.reference
    moving = dataclasses.replace(scan, origin=np.tile(scan.origin, (scan.num_points, 1)))
    pair = ScanPair(moving, moved_viewpoint.current)
    several = novelty.detect(pair)
    assert np.mean(result.added.point_states != several.added.point_states) < 0.01


def test_states_are_tensors_of_the_documented_type(rays):
    assert torch.from_numpy(rays.sights(ORIGIN[None] + 1.0, 0.1)).dtype == torch.uint8
