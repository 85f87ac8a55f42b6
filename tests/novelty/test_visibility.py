"""What another scan could see, on a wall looked at from one place."""

import dataclasses

import numpy as np
import pytest
import torch

import novelty
from novelty import Config, ScanPair
from novelty.simulation import room_pair
from novelty.visibility import Rays, Sight

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


def test_no_points_and_no_rays_give_no_sight(rays):
    assert rays.sights(np.zeros((0, 3)), 0.1).shape == (0,)
    assert Rays.of(np.zeros((0, 3)), ORIGIN).sights(np.ones((4, 3)), 0.1).tolist() == [Sight.NO_RAY] * 4


@pytest.fixture(scope="module")
def moved_viewpoint() -> ScanPair:
    return room_pair(seed=108, density=0.3, viewpoint_shift=1.5)


def test_surfaces_that_only_the_moved_sensor_sees_are_not_novel(moved_viewpoint):
    result = novelty.detect(moved_viewpoint)
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


def test_several_stations_see_more_than_one(moved_viewpoint):
    scan = moved_viewpoint.reference
    moving = dataclasses.replace(scan, origin=np.tile(scan.origin, (scan.num_points, 1)))
    pair = ScanPair(moving, moved_viewpoint.current)
    one, several = novelty.detect(moved_viewpoint), novelty.detect(pair)
    assert np.mean(one.added.point_states != several.added.point_states) < 0.01


def test_states_are_tensors_of_the_documented_type(rays):
    assert torch.from_numpy(rays.sights(ORIGIN[None] + 1.0, 0.1)).dtype == torch.uint8
