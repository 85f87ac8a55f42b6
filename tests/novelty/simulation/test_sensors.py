"""Sensors: where their rays go, what they read, what they lose."""

import numpy as np
import pytest

from benchmarks.simulation_figures import SHEETS, range_errors
from novelty.simulation import (
    SENSORS,
    World,
    get_sensor,
    make_pose,
)
from novelty.simulation.shapes import block, box, sphere
from tests.novelty.simulation.worlds import ROOM, scan_of


@pytest.mark.parametrize("name", SENSORS)
def test_noiseless_points_lie_on_the_surface_that_was_hit(name):
    pose = make_pose((500_000.2, -40.0, 7.0), yaw=30)
    world = World().add("room", box((-4, -3, 0), (4, 3, 2.5)), make_pose((500_000, -40, 6), yaw=12))
    scan = scan_of(world, get_sensor(name).with_density(0.2).ideal(), pose)
    local = (scan.points - world.bodies["room"].pose[:3, 3]) @ world.bodies["room"].pose[:3, :3]
    off_wall = np.min(np.abs(np.concatenate([local - (-4, -3, 0), local - (4, 3, 2.5)], axis=1)), axis=1)
    assert len(scan.points) > 300
    assert off_wall.max() < 1e-4
    assert np.array_equal(scan.points, scan.surface)


@pytest.mark.parametrize("name", SENSORS)
def test_every_ray_is_inside_the_field_of_view(name):
    pattern = get_sensor(name).pattern
    rays = pattern.directions().reshape(-1, 3).astype(np.float64)
    assert np.linalg.norm(rays, axis=1) == pytest.approx(1, abs=1e-6)
    assert pattern.covers(3.0 * rays).all()


@pytest.mark.parametrize("name", sorted(set(SENSORS) - {"lms_200"}))
def test_density_changes_the_number_of_rays(name):
    rays, fewer = (get_sensor(name).with_density(density).pattern.directions() for density in (1.0, 0.25))
    assert fewer[..., 0].size == pytest.approx(rays[..., 0].size / 4, rel=0.05)
    assert get_sensor("lms_200").with_density(0.25).pattern.spacing == 0.2


def test_the_field_of_view_has_an_outside():
    behind, above = np.array([[-1.0, 0.0, 0.0]]), np.array([[0.3, 0.0, 1.0]])
    assert not get_sensor("utm_30lx").pattern.covers(behind)[0]
    assert not get_sensor("urg_04lx").pattern.covers(above)[0]
    assert not get_sensor("vlp_16").pattern.covers(above)[0]
    assert not get_sensor("kinect").pattern.covers(behind)[0]


@pytest.mark.parametrize(("name", "std"), [("utm_30lx", 0.01), ("vlp_16", 0.03), ("urg_04lx", 0.02)])
def test_range_noise_has_the_standard_deviation_asked_for(name, std):
    scan = scan_of(ROOM, get_sensor(name).with_noise(std))
    error = np.linalg.norm(scan.points - scan.origins, axis=1) - np.linalg.norm(
        scan.surface - scan.origins, axis=1
    )
    assert error[~scan.mixed].std() == pytest.approx(std, rel=0.03)
    assert abs(error[~scan.mixed].mean()) < 0.03 * std


@pytest.mark.parametrize(
    ("name", "sheet"), [(name, sheet) for name, sheets in SHEETS.items() for sheet in sheets]
)
def test_range_errors_are_those_of_the_data_sheet(name, sheet):
    errors = range_errors(name, sheet.distance)
    if sheet.bound:
        assert 0.3 * sheet.std < errors.std() < sheet.std
    else:
        assert errors.std() == pytest.approx(sheet.std, rel=0.1)
    assert abs(errors.mean()) < 0.1 * sheet.std


def test_every_sensor_is_measured_against_its_data_sheet():
    assert set(SHEETS) == set(SENSORS)


def test_relative_noise_grows_with_range():
    far, near = (
        scan_of(World().add("shell", sphere((0, 0, 0), radius)), "urg_04lx", (0, 0, 0))
        for radius in (5.0, 1.0)
    )
    spread = [np.std(np.linalg.norm(scan.points - scan.surface, axis=1)) for scan in (far, near)]
    assert spread[0] > 3 * spread[1]


def test_depth_camera_quantises_disparity_and_error_grows_with_the_square():
    wall, camera = box((2.0, -5, -5), (2.1, 5, 5)), get_sensor("kinect").with_density(0.1)
    scans = [scan_of(World().add("wall", wall, (shift, 0, 0)), camera, (0, 0, 0)) for shift in (0.0, 2.0)]
    disparity = 586 * 0.075 / scans[0].points[:, 0] * 8
    assert disparity == pytest.approx(np.rint(disparity), abs=1e-3)
    spread = [np.std(scan.points[:, 0] - scan.surface[:, 0]) for scan in scans]
    assert spread[1] / spread[0] == pytest.approx(4, rel=0.15)
    assert spread[0] == pytest.approx(1.425e-3 * 4, rel=0.1)  # eq. 10 of the paper named in the catalogue


def test_depth_camera_has_shadows_on_one_side():
    world = (
        World().add("wall", box((3, -3, -3), (3.1, 3, 3))).add("post", box((1.5, -0.05, -3), (1.6, 0.05, 3)))
    )
    scan = scan_of(world, get_sensor("kinect").with_density(0.2).ideal(), (0, 0, 0))
    y = scan.surface[scan.bodies == 0][:, 1]
    wide = 0.2 * 3 / 1.5  # what the post alone would hide, and more
    assert np.sum((y < 0) & (y > -wide)) < 0.8 * np.sum((y > 0) & (y < wide))


def test_glass_hardly_returns_and_dropouts_are_random():
    world = ROOM.add("glass", box((3.0, -2, 0.2), (3.01, 2, 2.2)), reflectivity=0.04)
    scan = scan_of(world)
    opaque = scan_of(ROOM.add("glass", box((3.0, -2, 0.2), (3.01, 2, 2.2))))
    assert np.mean(scan.bodies == 1) / np.mean(opaque.bodies == 1) == pytest.approx(0.04, rel=0.3)
    rays = get_sensor("utm_30lx").pattern.directions()
    assert len(opaque.points) / (rays.shape[0] * rays.shape[1]) == pytest.approx(1 - 0.003, abs=0.002)


def test_mixed_pixels_lie_between_two_surfaces_only():
    flat = scan_of(
        World().add("floor", box((-30, -30, -0.1), (30, 30, 0))), get_sensor("utm_30lx").with_noise(0.0)
    )
    assert not flat.mixed.any()  # slanted is not an edge
    scan = scan_of(ROOM.add("post", block(0.3, 0.3, 2.5), (2, 0, 0)), get_sensor("utm_30lx").with_noise(0.0))
    assert 20 < scan.mixed.sum() < 2000
    distance = np.linalg.norm(scan.points - scan.origins, axis=1)[scan.mixed]
    assert ((distance > 1.8) & (distance < 5.2)).all()


def test_scan_order_is_line_by_line():
    sensor = get_sensor("utm_30lx").ideal()
    scan = scan_of(ROOM, sensor)
    rays = (scan.surface - scan.origins) / np.linalg.norm(scan.surface - scan.origins, axis=1, keepdims=True)
    step = np.degrees(np.arccos(np.clip(np.sum(rays[1:] * rays[:-1], axis=1), -1, 1)))
    assert np.median(step) == pytest.approx(0.5, abs=0.01)
    assert np.mean(step < 0.6) > 0.99
