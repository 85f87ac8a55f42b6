import numpy as np
import pytest
import torch

from novelty.errors import ConfigError, InputError
from novelty.preprocess import Preprocess, check_scan, prepare
from novelty.scan import Scan

PLAIN = Preprocess(outliers="none", ground="none")


def _room(rng, num_points=3000):
    points = rng.uniform(0, [4.0, 3.0, 2.5], (num_points, 3))
    points[: num_points // 2, 2] = 0
    points[num_points // 2 : -50, 0] = 0
    return points + rng.normal(scale=0.005, size=points.shape)


@pytest.fixture
def room(rng):
    return _room(rng)


def test_every_examined_point_is_where_it_was(room):
    given = room.copy()
    given[::7] = np.nan
    given[3, 1] = np.inf
    prepared = prepare([Scan(given)], Preprocess())
    kept = prepared.kept[0]
    assert (np.diff(kept) > 0).all()
    assert np.array_equal(prepared.points.points.numpy(), given[kept])
    assert len(kept) + sum(prepared.dropped[0].values()) == prepared.num_given[0] == len(given)
    assert prepared.dropped[0]["not finite"] == len(given[::7]) + 1
    assert prepared.dropped[0]["ground"] > 1000
    assert prepared.dropped[0]["outlier"] > 0
    assert any("finite" in note for note in prepared.notes[0])


def test_cells_have_the_moments_of_the_examined_points(room):
    prepared = prepare([Scan(room)], PLAIN)
    owner = prepared.cell_of_point.numpy()
    assert np.array_equal(np.bincount(owner), prepared.cells.weights.numpy())
    means = np.stack([np.bincount(owner, room[:, d]) for d in range(3)], 1) / np.bincount(owner)[:, None]
    np.testing.assert_allclose(prepared.cells.points.numpy(), means, atol=1e-12)


def test_a_batch_equals_its_members_alone_in_any_order(rng):
    scans = [Scan(_room(rng, count)) for count in (2500, 40, 900)] + [Scan(np.zeros((0, 3)))]
    order = [3, 1, 0, 2]
    together = prepare([scans[place] for place in order], Preprocess())
    for row, place in enumerate(order):
        alone, member = prepare([scans[place]], Preprocess()), together.select([row])
        assert torch.equal(alone.cells.points, member.cells.points)
        assert torch.equal(alone.cells.spreads, member.cells.spreads)
        assert torch.equal(alone.cell_of_point, member.cell_of_point)
        assert torch.equal(alone.spacing, member.spacing) or len(alone.kept[0]) < 2
        assert np.array_equal(alone.kept[0], member.kept[0])
        assert alone.notes == member.notes


@pytest.mark.parametrize(("unit", "metres"), [("mm", 0.001), ("cm", 0.01), ("ft", 0.3048), ("in", 0.0254)])
def test_lengths_are_metres_whatever_the_unit(room, unit, metres):
    origin = np.array([1.0, 1.0, 1.5])
    settings = Preprocess(max_range=3.0, max_height=2.0)
    expected = prepare([Scan(room, origin)], settings)
    scaled = prepare([Scan(room / metres, origin / metres)], settings, unit=unit)
    assert np.array_equal(scaled.kept[0], expected.kept[0])
    torch.testing.assert_close(scaled.cells.points, expected.cells.points)
    torch.testing.assert_close(scaled.spacing, expected.spacing)
    np.testing.assert_allclose(scaled.origins[0], origin)


def test_millimetres_read_as_metres_are_noted_and_a_scan_far_from_the_origin_is_not(room):
    [notes] = prepare([Scan(room * 1000)], PLAIN).notes
    assert any("pass --unit mm" in note for note in notes)
    assert prepare([Scan(room * 1000)], PLAIN, unit="mm").notes == ((),)
    assert prepare([Scan(np.add(room, [5e5, 5e6, 0]))], PLAIN).notes == ((),)


def test_an_unknown_unit_and_a_direction_without_length_are_refused(room):
    with pytest.raises(ConfigError, match="one of m, cm, mm"):
        prepare([Scan(room)], PLAIN, unit="inch")
    with pytest.raises(ConfigError, match="direction"):
        prepare([Scan(room)], Preprocess(up=(0, 0, 0)))


def test_range_is_measured_from_where_the_sensor_stood(room):
    fixed = prepare(
        [Scan(room, (0, 0, 1))], Preprocess(min_range=0.5, max_range=2, outliers="none", ground="none")
    )
    ranges = np.linalg.norm(room - [0, 0, 1], axis=1)
    assert np.array_equal(fixed.kept[0], np.flatnonzero((ranges >= 0.5) & (ranges <= 2)))
    moving = room + np.array([0.0, 1.0, 0.0])
    moving[:10] += [0.0, 5.0, 0.0]
    prepared = prepare([Scan(room, moving)], Preprocess(max_range=2, outliers="none", ground="none"))
    assert np.array_equal(prepared.kept[0], np.arange(10, len(room)))


def test_a_range_without_an_origin_is_left_out_and_said(room):
    prepared = prepare([Scan(room)], Preprocess(max_range=1, outliers="none", ground="none"))
    assert len(prepared.kept[0]) == len(room)
    assert "origin is unknown" in prepared.notes[0][0]


def test_a_band_of_heights_runs_along_up(room):
    settings = Preprocess(min_height=-2.0, max_height=-0.5, up=(0, -3, 0), outliers="none", ground="none")
    prepared = prepare([Scan(room)], settings)
    assert np.array_equal(prepared.kept[0], np.flatnonzero((room[:, 1] >= 0.5) & (room[:, 1] <= 2.0)))


def test_a_far_surface_is_no_outlier_unless_the_whole_scan_is_the_measure(rng):
    near, far = rng.uniform(size=(5000, 3)) * [1, 1, 0], 5 + 3 * rng.uniform(size=(200, 3)) * [1, 1, 0]
    scan = Scan(np.concatenate([near, far]))
    kept = {
        rule: prepare([scan], Preprocess(ground="none", outliers=rule)).kept[0]
        for rule in ("local", "statistical")
    }
    assert (kept["local"] >= 5000).sum() > 190
    assert (kept["statistical"] >= 5000).sum() < 20


def test_sparse_outliers_go_and_clumps_of_equal_points_stay(rng):
    surface = rng.uniform(size=(3000, 3)) * [1, 1, 0]
    strays, clump = rng.uniform(3, 9, (10, 3)), np.full((30, 3), 0.5)
    settings = Preprocess(ground="none")
    prepared = prepare([Scan(np.concatenate([surface, strays, clump]))], settings)
    assert not np.isin(np.arange(3000, 3010), prepared.kept[0]).any()
    assert np.isin(np.arange(3010, 3040), prepared.kept[0]).all()


def test_points_with_equal_distances_are_not_outliers():
    prepared = prepare([Scan(np.full((50, 3), 2.0))], Preprocess())
    assert len(prepared.kept[0]) == 50
    assert prepared.cells.sizes == (1,)


@pytest.mark.parametrize("count", [*range(1, 22)])
def test_small_scans_work(rng, count):
    points = rng.normal(size=(count, 3))
    prepared = prepare([Scan(points)], Preprocess())
    assert prepared.cells.weights.sum() == len(prepared.kept[0])
    assert len(prepared.kept[0]) >= min(count, 20)


@pytest.mark.parametrize(
    ("points", "settings", "advice"),
    [
        (np.full((5, 3), np.nan), Preprocess(), "not finite"),
        (np.random.default_rng(0).normal(size=(50, 3)), Preprocess(min_height=50), "min_height"),
        (
            np.random.default_rng(0).uniform(size=(500, 3)) * [1, 1, 0],
            Preprocess(outliers="none"),
            "set ground to none",
        ),
    ],
)
def test_a_scan_of_which_nothing_is_left_keeps_its_place_and_says_why(room, points, settings, advice):
    prepared = prepare([Scan(points), Scan(room - room.min(axis=0) + 60)], settings)
    assert prepared.cells.sizes[0] == 0
    assert prepared.cells.sizes[1] > 0
    assert len(prepared.kept[0]) == 0
    assert advice in prepared.notes[0][-1]
    assert torch.isnan(prepared.spacing[0])
    assert torch.isnan(prepared.cell_size[0])


def test_without_simplification_every_point_is_a_cell(room):
    prepared = prepare([Scan(room)], Preprocess(simplify="none", ground="none", outliers="none"))
    assert torch.equal(prepared.cell_of_point, torch.arange(len(room)))
    assert torch.equal(prepared.cells.points, prepared.points.points)
    assert prepared.cell_size[0] == 0


def test_spacing_and_cell_size_are_those_of_a_grid():
    side = np.arange(100) * 0.03
    grid = np.stack([*np.meshgrid(side, side), np.zeros((100, 100))], axis=-1).reshape(-1, 3)
    duplicated = np.concatenate([grid, grid])
    prepared = prepare([Scan(duplicated)], Preprocess(ground="none", outliers="none", max_cell_size=18))
    assert float(prepared.spacing[0]) == pytest.approx(0.03)
    assert 0.02 < float(prepared.cell_size[0]) < 0.05


def test_coordinates_half_a_million_metres_away_give_the_same_cells(room):
    shift = np.array([5e5, 4.2e6, 300.0])
    near, far = prepare([Scan(room)], Preprocess()), prepare([Scan(room + shift)], Preprocess())
    assert len(near.kept[0]) == pytest.approx(len(far.kept[0]), abs=3)
    np.testing.assert_allclose(far.spacing, near.spacing, rtol=1e-5)
    variances = torch.linalg.eigvalsh(far.cells.spreads)
    assert variances.min() > -1e-15


def test_an_origin_that_is_not_finite_counts_as_unknown(room):
    prepared = prepare([Scan(room, (np.nan, 0, 0))], PLAIN)
    assert prepared.origins == (None,)
    assert "origin" in prepared.notes[0][0]


def test_an_empty_batch_is_refused():
    with pytest.raises(InputError, match="at least one scan"):
        prepare([], PLAIN)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 3)), "found none"),
        (np.full((4, 3), np.nan), "finite"),
        (np.concatenate([np.ones((9, 3)), [[np.nan, 0, 0]]]), "different places"),
    ],
)
def test_a_scan_about_which_nothing_can_be_said_is_refused_by_name(points, message):
    with pytest.raises(InputError, match=f"'kitchen'.*{message}"):
        check_scan(Scan(points, name="kitchen"))


def test_a_usable_scan_passes(room):
    check_scan(Scan(room))


@pytest.mark.data
def test_a_table_seen_by_a_tilted_camera_loses_no_ground(data_dir):
    from novelty.io import read_scan

    scan = read_scan(data_dir / "mosd" / "learn2-learn8" / "reference.ply")
    prepared = prepare([scan], Preprocess())
    assert prepared.dropped[0].get("ground", 0) == 0
    assert any("ground" in note for note in prepared.notes[0])
    assert prepared.cells.weights.max() <= 20


@pytest.mark.data
@pytest.mark.parametrize("name", ["room_scan1.pcd", "room_scan2.pcd"])
def test_the_floor_of_a_real_room_is_taken_out(data_dir, name):
    from novelty.io import read_scan

    prepared = prepare([read_scan(data_dir / "lidar" / name)], Preprocess())
    assert 0.05 < prepared.dropped[0]["ground"] / prepared.num_given[0] < 0.25
