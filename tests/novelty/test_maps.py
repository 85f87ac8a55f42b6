"""Maps: as good as the scan behind them, small, kept up to date, and refused when damaged."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import novelty
from gmmtorch import PointClouds
from novelty import Config, ConfigError, InputError, Scan, SceneMap
from novelty.maps import is_map
from novelty.maps.compare import most_common
from novelty.maps.drawing import draw_points
from novelty.maps.packing import pack_cells, unpack_cells
from novelty.maps.storage import load_arrays, save_arrays
from novelty.maps.views import MAX_VIEWS, View, renewed_views
from novelty.preprocess import prepare
from novelty.preprocess.ground import NoGround, Plane
from novelty.simulation import RayScene, get_sensor, make_scene, measure, pair_up, simulate_pair
from novelty.visibility import Sight, joint_sights, stations_of

DENSITY = 0.35


@pytest.fixture(scope="module")
def place():
    """A room before (A) and after (B) a person came and a thing was taken away, and both scanned once more."""
    pair = simulate_pair("room", 31, ("person", "remove"), density=DENSITY)
    sensor = get_sensor("utm_30lx").with_density(DENSITY)
    pose = make_scene("room", 31).viewpoint[None]

    def again(world, seed):
        return measure(RayScene(world), sensor, pose, np.random.default_rng(seed))

    back = pair_up(again(pair.after, 103), again(pair.before, 101)).scans
    return {
        "A": pair.scans.reference,
        "B": pair.scans.current,
        "A2": back.current,
        "B2": again(pair.after, 102).scan(name="B2"),
        "B to A2": back,
        "A to B": pair.scans,
    }


@pytest.fixture(scope="module")
def scene_map(place):
    return novelty.fit(place["A"], Config(max_components=10))


@pytest.fixture(scope="module")
def updated(place, scene_map):
    return novelty.update(scene_map, place["B"])


@pytest.fixture(scope="module")
def found(place, scene_map):
    """What the map says of B."""
    return novelty.detect_against(scene_map, place["B"])


def kappa(scan, labels):
    return novelty.evaluate(scan.labels == 1, labels, ignore=scan.labels >= 2).kappa


class TestDetectAgainst:
    def test_is_as_good_as_the_scan_itself(self, place, found):
        with_scan = novelty.detect(place["A to B"])
        wanted = kappa(place["B"], with_scan.added.point_labels)
        assert wanted > 0.9
        assert kappa(place["B"], found.added.point_labels) == pytest.approx(wanted, abs=0.03)
        assert len(found.added.objects) == len(with_scan.added.objects)
        assert len(found.removed.objects) == len(with_scan.removed.objects) > 0

    def test_removed_speaks_of_cells(self, place, scene_map, found):
        removed = found.removed
        cells = scene_map.as_scan()
        assert removed.point_labels.shape == removed.point_scores.shape == (cells.num_points,)
        gone = cells.points[removed.point_labels]
        truth = place["A"].points[place["A"].labels == 1]
        apart = np.linalg.norm(gone[:, None] - truth, axis=2).min(axis=1)
        assert np.quantile(apart, 0.9) < 0.1

    def test_the_same_place_has_not_changed(self, place, scene_map):
        assert not novelty.detect_against(scene_map, place["A2"]).changed

    @pytest.mark.parametrize("detector", ["joint_mixture", "structural_matching"])
    def test_any_detector_compares_with_a_map(self, place, scene_map, detector):
        config = Config(detector=detector, max_components=12)
        found = novelty.detect_against(scene_map, place["B"], config)
        assert kappa(place["B"], found.added.point_labels) > 0.8

    def test_the_unit_is_the_maps(self, place):
        in_mm = [Scan(s.points * 1000, s.origin * 1000, s.labels) for s in (place["A"], place["B"])]
        scene_map = novelty.fit(in_mm[0], Config(unit="mm"))
        found = novelty.detect_against(scene_map, in_mm[1])
        assert kappa(place["B"], found.added.point_labels) > 0.9
        assert scene_map.as_scan().points.max() > 1000
        assert max(found.added.objects[0].extent) > 100
        with pytest.raises(InputError, match="set unit to mm"):
            novelty.detect_against(scene_map, in_mm[1], Config())

    def test_a_scan_of_which_nothing_is_left_does_not_touch_the_map(self, place):
        low = novelty.fit(place["A"], Config(max_components=8).replace(**{"preprocess.max_height": 5.0}))
        above = Scan(place["A"].points + np.array([0.0, 0.0, 50.0]), name="above")
        assert not novelty.detect_against(low, above).changed
        with pytest.raises(InputError, match="above has no point left to examine"):
            novelty.update(low, above)

    def test_other_preprocessing_is_refused(self, place, scene_map):
        other = Config().replace(**{"preprocess.max_cell_size": 5})
        with pytest.raises(ConfigError, match="preprocess"):
            novelty.detect_against(scene_map, place["B"], other)


class TestFit:
    def test_needs_cells(self, place):
        with pytest.raises(ConfigError, match="simplify"):
            novelty.fit(place["A"], Config().replace(**{"preprocess.simplify": "none"}))

    def test_needs_points(self):
        with pytest.raises(InputError, match="attic"):
            novelty.fit(Scan(np.full((5, 3), np.nan), name="attic"))

    def test_without_an_origin_there_is_no_view(self, place):
        assert novelty.fit(Scan(place["A"].points)).views == ()

    def test_far_from_the_origin_it_is_the_same(self, place, scene_map, found, tmp_path):
        """Cells are stored relative to their middle: float32 would lose 3 cm at 5e5 m."""
        shift = np.array([5e5, -4e6, 120.0])
        moved = [Scan(s.points + shift, s.origin + shift) for s in (place["A"], place["B"])]
        novelty.fit(moved[0], scene_map.config).save(tmp_path / "far.safetensors")
        far = novelty.detect_against(SceneMap.load(tmp_path / "far.safetensors"), moved[1])
        assert np.mean(far.added.point_labels != found.added.point_labels) < 1e-3


class TestStorage:
    def test_a_loaded_map_answers_as_the_one_saved(self, place, scene_map, found, tmp_path):
        file = tmp_path / "room.safetensors"
        scene_map.save(file)
        loaded = SceneMap.load(file)
        theirs = novelty.detect_against(loaded, place["B"])
        assert np.mean(found.added.point_labels != theirs.added.point_labels) < 1e-3
        assert np.mean(found.removed.point_labels != theirs.removed.point_labels) < 2e-3
        assert (loaded.config, loaded.name, loaded.num_scans) == (scene_map.config, scene_map.name, 1)
        assert isinstance(loaded.ground, Plane)
        assert file.stat().st_size < place["A"].points.astype(np.float32).nbytes / 4

    def test_cells_keep_their_moments(self, scene_map):
        cells = scene_map.cells
        back = unpack_cells("x", pack_cells("x", cells))
        extent = cells.spreads.diagonal(dim1=1, dim2=2).sum(-1)
        assert torch.equal(back.weights, cells.weights)
        assert (back.points - cells.points).abs().max() < 1e-5
        error = (back.spreads - cells.spreads).flatten(1).norm(dim=1)
        assert (error <= 2e-3 * extent + 1e-12).all()
        # The thickness of a wall, a hundredth of its width, survives the rounding.
        thin, kept = (
            torch.linalg.eigvalsh(s)[:, 0].clamp_min(0).sqrt() for s in (cells.spreads, back.spreads)
        )
        assert ((kept - thin).abs() <= 2e-3 * extent.sqrt()).all()

    def test_cells_of_one_place_or_one_line_are_kept(self):
        line = torch.diag(torch.tensor([4.0, 0.0, 0.0], dtype=torch.float64))
        turn = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64, generator=torch.manual_seed(0)))[0]
        spreads = torch.stack([torch.zeros_like(line), line, turn @ line @ turn.T])
        cells = PointClouds.from_list(
            [torch.zeros(3, 3)], weights=[torch.tensor([1.0, 2.0, 70_000.0])], spreads=[spreads]
        )
        back = unpack_cells("x", pack_cells("x", cells))
        assert torch.allclose(back.spreads, spreads, atol=5e-3)
        assert back.weights.tolist() == [1, 2, 70_000]

    def test_what_cannot_be_read_is_refused(self, scene_map, tmp_path):
        file = tmp_path / "room.safetensors"
        with pytest.raises(InputError, match="no such map"):
            SceneMap.load(file)
        file.write_bytes(b"ply\nformat ascii 1.0\n")
        with pytest.raises(InputError, match="damaged or is no map"):
            SceneMap.load(file)
        scene_map.save(file)
        whole = file.read_bytes()
        file.write_bytes(whole[:-100])
        with pytest.raises(InputError, match="damaged"):
            SceneMap.load(file)
        file.write_bytes(whole[:-100] + bytes([whole[-100] ^ 1]) + whole[-99:])
        with pytest.raises(InputError, match="checksum"):
            SceneMap.load(file)

    def test_other_files_and_formats_are_refused(self, scene_map, tmp_path, monkeypatch):
        file = tmp_path / "mixture.safetensors"
        scene_map.model.mixtures.save(file)
        with pytest.raises(InputError, match=r"found gmmtorch\.GaussianMixtures"):
            SceneMap.load(file)
        with monkeypatch.context() as patch:
            patch.setattr("novelty.maps.storage.FORMAT", "0")
            scene_map.save(file)
        with pytest.raises(InputError, match="format 0"):
            SceneMap.load(file)

    def test_settings_of_another_version_are_refused(self, scene_map, tmp_path):
        file = tmp_path / "room.safetensors"
        scene_map.save(file)
        arrays, record = load_arrays(file)
        record["config"]["fit"]["warp"] = 9
        save_arrays(file, arrays, record)
        with pytest.raises(InputError, match="warp"):
            SceneMap.load(file)

    def test_a_map_is_told_by_its_extension_or_its_first_bytes(self, scene_map, tmp_path):
        scene_map.save(tmp_path / "room.map")
        (tmp_path / "scan.xyz").write_text("1 2 3\n")
        assert is_map(tmp_path / "room.map")
        assert is_map(tmp_path / "nothing.safetensors")
        assert not is_map(tmp_path / "scan.xyz")
        assert not is_map(tmp_path / "nothing.ply")


class TestUpdate:
    def test_what_came_and_went_is_in_the_map(self, place, scene_map, updated):
        assert updated.result.changed
        assert updated.cells_added > 10
        assert updated.cells_forgotten > 5
        assert updated.note == ""
        assert (updated.scene_map.num_scans, scene_map.num_scans) == (2, 1)
        assert not novelty.detect_against(updated.scene_map, place["B2"]).changed

    def test_the_reverse_change_is_found(self, place, updated):
        back = place["B to A2"]
        found = novelty.detect_against(updated.scene_map, place["A2"])
        wanted = novelty.detect(back)
        assert len(found.added.objects) == len(wanted.added.objects) > 0
        assert len(found.removed.objects) == len(wanted.removed.objects) > 0
        assert kappa(back.current, found.added.point_labels) > 0.85

    def test_the_map_given_is_not_touched(self, place, scene_map, updated):
        assert novelty.detect_against(scene_map, place["B"]).changed

    def test_a_map_does_not_grow_without_news(self, place, updated):
        scene_map, size = updated.scene_map, len(updated.scene_map)
        for _ in range(2):
            scene_map = novelty.update(scene_map, place["B2"]).scene_map
        assert len(scene_map) < 1.03 * size
        assert len(scene_map.views) == len(updated.scene_map.views) == 1

    def test_out_of_sight_is_not_forgotten(self, place, scene_map):
        """A scan of one half of the room leaves the map of the other half as it was."""
        scan = place["A2"]
        seen = scan.points[:, 0] > scan.origin[0]
        half = novelty.update(scene_map, Scan(scan.points[seen], scan.origin))
        behind = (scene_map.cells.points[:, 0] < scan.origin[0] - 0.5).sum()
        kept = (half.scene_map.cells.points[:, 0] < scan.origin[0] - 0.5).sum()
        assert behind > 100
        assert kept == behind

    def test_without_an_origin_nothing_is_forgotten(self, place, scene_map):
        blind = novelty.update(scene_map, Scan(place["B"].points))
        assert blind.cells_forgotten == 0
        assert "origin" in blind.note

    def test_a_denser_scan_refines(self, place, scene_map):
        dense = simulate_pair("room", 31, ("person", "remove"), density=2.5 * DENSITY).scans.reference
        finer = novelty.update(scene_map, dense)
        assert finer.cells_refined > len(scene_map)
        assert finer.scene_map.cell_size < 0.8 * scene_map.cell_size
        assert not novelty.detect_against(finer.scene_map, place["A2"]).changed

    def test_a_scan_of_another_place_is_refused(self, place, scene_map):
        elsewhere = Scan(place["A2"].points + 60, place["A2"].origin + 60)
        with pytest.raises(InputError, match="does not fit the map"):
            novelty.update(scene_map, elsewhere)


class TestViews:
    def test_a_place_seen_again_has_one_view_and_places_are_few(self, place):
        rays = stations_of(place["A"].points, place["A"].origin)[0]
        views = (View.of(rays),)
        assert len(renewed_views(views, [replace(rays, origin=rays.origin + 0.01)], 0.02)) == 1
        for step in range(1, MAX_VIEWS + 2):
            views = renewed_views(views, [replace(rays, origin=rays.origin + step)], 0.02)
        assert len(views) == MAX_VIEWS
        assert views[-1].origin == pytest.approx(rays.origin + step)
        assert renewed_views(views, [], 0.02) == views

    def test_ends_of_rays_on_what_has_gone_are_dropped(self):
        y, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 60)))
        thing = np.abs(y) < 0.3
        before = np.column_stack([np.where(thing, 2.0, 3.0), y, z])
        after = np.column_stack([np.full(len(y), 3.0), y, z])
        view = View.of(stations_of(before, np.zeros(3))[0])
        seen_since = stations_of(after, np.array([0.0, 1.0, 0.0]))
        old, _ = renewed_views([view], seen_since, 0.01)
        gone, kept = (ends.points.abs() for ends in (view.ends, old.ends))
        passed = [(p[:, 0] < 2.5) & (p[:, 1] < 0.25) & (p[:, 2] < 0.5) for p in (gone, kept)]
        assert [int(where.sum() > 0) for where in passed] == [1, 0]
        assert (kept[:, 0] > 2.5).sum() == (gone[:, 0] > 2.5).sum()


def test_drawn_points_have_the_moments_of_their_cells(rng):
    factor = rng.normal(size=(4, 3, 3)) * np.array([1.0, 0.3, 0.05])
    spreads = torch.from_numpy(factor @ factor.transpose(0, 2, 1))
    means = torch.from_numpy(rng.normal(size=(4, 3)) * 10)
    counts = torch.tensor([4000.0, 4000.0, 1.0, 3000.0])
    points, cell = draw_points(PointClouds.from_list([means], weights=[counts], spreads=[spreads]))
    assert torch.bincount(cell).tolist() == counts.tolist()
    for row in (0, 1, 3):
        drawn = points.points[cell == row]
        assert torch.allclose(drawn.mean(0), means[row], atol=0.05 * float(spreads[row].trace().sqrt()))
        assert torch.allclose(drawn.T.cov(), spreads[row], atol=0.05 * float(spreads[row].trace()))


def test_most_common():
    values, cell = np.array([7, 7, 2, 255, 2, 255]), np.array([1, 1, 1, 0, 0, 0])
    assert most_common(values, cell).tolist() == [255, 7]


class TestGroundOfTheMap:
    def test_its_plane_serves_a_scan_without_one(self, rng):
        floor = np.column_stack([rng.uniform(0, 4, (300, 2)), rng.normal(0, 0.002, 300)])
        wall = np.column_stack([rng.uniform(0, 4, 3000), np.zeros(3000), rng.uniform(0.1, 2.5, 3000)])
        scan = Scan(np.concatenate([floor[:60], wall]))
        known = Plane(np.array([0.0, 0.0, 1.0]), 0.0, 0.02)
        own = prepare([scan], Config().preprocess)
        assert isinstance(own.grounds[0], NoGround)
        followed = prepare([scan], Config().preprocess, "m", [known])
        assert followed.grounds[0] is known
        assert (followed.points.points[:, 2] > 0.02).all()

    def test_a_map_that_kept_its_ground_keeps_the_scans(self, place):
        scans = [Scan(place["A"].points)]
        assert isinstance(prepare(scans, Config().preprocess).grounds[0], Plane)
        kept = prepare(scans, Config().preprocess, "m", [NoGround("none was seen")])
        assert kept.dropped[0].get("ground", 0) == 0


class TestStations:
    def test_of_several_places_the_one_that_saw_through_decides(self):
        y, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20)))
        near, far = (np.column_stack([np.full(400, x), y, z]) for x in (1.0, 3.0))
        origins = np.repeat([[0.0, 0, 0], [0.5, 0, 0]], 400, axis=0)
        stations = stations_of(np.concatenate([near, far]), origins)
        assert len(stations) == 2
        place = np.array([[2.0, 0.0, 0.0]])
        assert stations[0].sights(place, 0.01).tolist() == [Sight.HIDDEN]
        assert joint_sights(stations, place, 0.01).tolist() == [Sight.SEEN_THROUGH]

    def test_a_moving_sensor_has_no_station(self, rng):
        points = rng.normal(size=(500, 3))
        assert stations_of(points, points + 1) == ()
        assert stations_of(points, None) == ()
