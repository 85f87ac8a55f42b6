"""The whole way from two scans to labelled points, on simulated pairs of a few thousand points."""

import dataclasses
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

import novelty
from novelty import Config, PointState, ResultStatus, Scan, ScanPair
from novelty.config import detector_names
from novelty.report.outputs import write_labelled_scan
from novelty.simulation import corridor_pair, room_pair
from novelty.simulation.pairs import simulate_pair

DENSITY = 0.15


@pytest.fixture(scope="module")
def corridor() -> ScanPair:
    return corridor_pair(seed=104, density=DENSITY)


@pytest.fixture(scope="module")
def room() -> ScanPair:
    return room_pair(seed=105, density=DENSITY)


@pytest.fixture(scope="module")
def unchanged() -> ScanPair:
    return room_pair(seed=106, changes=(), density=DENSITY)


@pytest.fixture(scope="module")
def of_corridor(corridor) -> novelty.NoveltyResult:
    return novelty.detect(corridor)


@pytest.fixture(scope="module")
def of_room_by(room) -> Callable[[str], novelty.NoveltyResult]:
    """What each detector says of the room."""
    return cache(lambda detector: novelty.detect(room, Config(detector=detector)))


@pytest.fixture(scope="module")
def of_room(of_room_by) -> novelty.NoveltyResult:
    return of_room_by(Config().detector)


@pytest.fixture(scope="module")
def of_unchanged(unchanged) -> novelty.NoveltyResult:
    return novelty.detect(unchanged)


def kappa(scan: Scan, change: novelty.Change) -> float:
    return novelty.evaluate(scan.labels == 1, change.point_labels, ignore=scan.labels >= 2).kappa


def shifted(pair: ScanPair, offset: np.ndarray, scale: float = 1.0) -> ScanPair:
    def move(scan: Scan) -> Scan:
        return Scan((scan.points + offset) * scale, (scan.origin + offset) * scale, scan.labels, scan.name)

    return ScanPair(move(pair.reference), move(pair.current), pair.name)


def assert_same(result: novelty.NoveltyResult, expected: novelty.NoveltyResult, atol: float = 1e-8) -> None:
    for mine, other in ((result.added, expected.added), (result.removed, expected.removed)):
        assert np.array_equal(mine.point_states, other.point_states)
        assert np.array_equal(mine.point_components, other.point_components)
        assert len(mine.components) == len(other.components)
        for a, b in zip(mine.components, other.components, strict=True):
            np.testing.assert_allclose(a.mean, b.mean, rtol=0, atol=atol)
            np.testing.assert_allclose(a.covariance, b.covariance, rtol=0, atol=atol)


@pytest.mark.parametrize("detector", detector_names())
def test_every_detector_labels_every_point_of_both_scans(detector, room, of_room_by):
    result = of_room_by(detector)
    for scan, change in ((room.current, result.added), (room.reference, result.removed)):
        assert change.point_labels.shape == (scan.num_points,)
        assert np.array_equal(change.point_labels, np.isin(change.point_states, (1, 4)))
        examined = change.point_states != 255
        assert np.array_equal(examined, change.point_components >= 0)
        assert np.isfinite(change.point_scores[examined]).all()
        assert np.isnan(change.point_scores[~examined]).all()
        assert sum(thing.num_points for thing in change.objects) == change.point_labels.sum()


def test_new_objects_are_found_point_by_point(corridor, room, of_corridor, of_room):
    for pair, result in ((corridor, of_corridor), (room, of_room)):
        assert result.changed
        assert kappa(pair.current, result.added) > 0.9


def test_each_inserted_object_is_found():
    simulated = simulate_pair("room", 107, ("person", "box", "cylinder"), density=0.25)
    found = novelty.detect(simulated.scans).added.point_labels
    truth = simulated.current
    for name in ("person 1", "box 1", "cylinder 1"):
        seen = (truth.objects == truth.names.index(name)) & (truth.labels == 1)
        assert found[seen].mean() > 0.7, name


def test_the_same_scene_measured_twice_has_no_novelty(of_unchanged):
    assert not of_unchanged.changed
    assert of_unchanged.added.objects == ()
    assert of_unchanged.removed.objects == ()


def test_a_scan_against_itself_has_no_novelty(room):
    assert not novelty.detect(ScanPair(room.reference, room.reference)).changed


def test_exchanging_the_scans_exchanges_added_and_removed(room):
    forth = novelty.detect(room, Config().replace(**{"registration.method": "none"}))
    back = novelty.detect(
        ScanPair(room.current, room.reference), Config().replace(**{"registration.method": "none"})
    )
    assert np.array_equal(forth.added.point_labels, back.removed.point_labels)
    assert np.array_equal(forth.removed.point_labels, back.added.point_labels)


def test_a_batch_equals_its_pairs_one_by_one(corridor, room, unchanged, of_corridor, of_room, of_unchanged):
    together = novelty.detect_many([corridor, room, unchanged])
    for result, alone in zip(together, (of_corridor, of_room, of_unchanged), strict=True):
        assert_same(result, alone)
        for scan in ("reference", "current"):
            assert len(result.details[scan]["mdl_path"]) == len(alone.details[scan]["mdl_path"])


def test_far_from_the_origin_and_in_millimetres_the_labels_are_the_same(room, of_room):
    far = novelty.detect(shifted(room, np.array([5e5, 4e5, 100.0])))
    in_millimetres = novelty.detect(shifted(room, np.zeros(3), scale=1000.0), Config(unit="mm"))
    for result in (far, in_millimetres):
        for mine, other in ((result.added, of_room.added), (result.removed, of_room.removed)):
            assert (mine.point_states != other.point_states).mean() < 1e-3


@pytest.mark.parametrize("seed", [106, 107])
def test_what_the_other_scan_could_not_see_is_no_evidence_of_a_change(seed):
    pair = room_pair(seed, changes=(), density=0.15, viewpoint_shift=1.5)
    result = novelty.detect(pair)
    assert not result.changed
    hidden = [c for change in (result.added, result.removed) for c in change.components if c.novel]
    assert min(c.p_value for c in hidden) < 0.01
    assert result.p_value > 0.05


@pytest.mark.parametrize(
    ("scale", "settings"),
    [(1 / 16, {}), *((16.0, {"detector": name, "refine.method": "none"}) for name in detector_names())],
)
def test_no_length_is_chosen_for_rooms(scale, settings, corridor):
    config, scaled = Config().replace(**settings), shifted(corridor, np.zeros(3), scale)
    result, expected = (novelty.detect(scans, config) for scans in (scaled, corridor))
    assert expected.added.point_labels.any()
    for mine, other in ((result.added, expected.added), (result.removed, expected.removed)):
        assert (mine.point_states != other.point_states).mean() < 1e-3


@pytest.mark.parametrize("detector", ["likelihood", "unbalanced_emd"])
def test_every_examined_point_has_a_p_value_and_new_things_small_ones(room, of_room_by, tmp_path, detector):
    added = of_room_by(detector).added
    examined = added.point_states != PointState.NOT_EXAMINED
    assert np.isnan(added.point_p_values[~examined]).all()
    assert ((added.point_p_values[examined] > 0) & (added.point_p_values[examined] <= 1)).all()
    assert added.objects[0].p_value < 0.01 < np.median(added.point_p_values[examined])
    write_labelled_scan(tmp_path / "room.ply", room.current, added)
    assert b"property float p_value" in (tmp_path / "room.ply").read_bytes()[:1000]


def test_without_origins_it_is_said_from_which_size_on_groups_count(room):
    rng = np.random.default_rng(0)
    foliage = room.reference.points.mean(axis=0) + 0.3 * rng.normal(size=(800, 3))
    rough = Scan(np.concatenate([room.reference.points, foliage]))
    with_rays = dataclasses.replace(rough, origin=room.reference.origin)
    blind = novelty.detect(ScanPair(rough, Scan(room.current.points)))
    assert "reference scan: groups of up to" in blind.message
    assert "groups of up to" not in novelty.detect(ScanPair(with_rays, room.current)).message


def test_records_are_in_the_unit_and_frame_of_the_scan_as_given(room, of_room):
    metres = of_room.added
    offset = np.array([10.0, -4.0, 2.0])
    moved = novelty.detect(shifted(room, offset, scale=1000.0), Config(unit="mm")).added
    np.testing.assert_allclose(
        moved.objects[0].centroid, 1000 * (metres.objects[0].centroid + offset), rtol=1e-3
    )
    # Which of two components that are alike comes first may differ by rounding.
    expected = np.array([1000 * (component.mean + offset) for component in metres.components])
    means = np.array([component.mean for component in moved.components])
    nearest = np.linalg.norm(means[:, None] - expected, axis=2).argmin(1)
    assert sorted(nearest) == list(range(len(expected)))
    np.testing.assert_allclose(means, expected[nearest], atol=1.0)


def test_missing_returns_keep_their_place(room):
    points = np.array(room.current.points)
    points[100:200] = np.nan
    points[300] = np.inf
    pair = ScanPair(room.reference, dataclasses.replace(room.current, points=points))
    result = novelty.detect(pair)
    assert (result.added.point_states[100:200] == 255).all()
    assert len(result.added.point_states) == room.current.num_points
    assert result.details["current"]["points_dropped"]["not finite"] == 101
    assert kappa(pair.current, result.added) > 0.9


BAD_SCANS = {
    "empty": np.zeros((0, 3)),
    "no finite point": np.full((10, 3), np.nan),
    "identical points": np.ones((50, 3)),
}


@pytest.fixture(scope="module")
def bad_pairs(room) -> dict[str, ScanPair]:
    return {
        kind: ScanPair(room.reference, Scan(points, name="broken"), name="bad")
        for kind, points in BAD_SCANS.items()
    }


@pytest.fixture(scope="module")
def results_with_bad_pairs(room, bad_pairs, unchanged) -> list[novelty.NoveltyResult]:
    return novelty.detect_many([room, *bad_pairs.values(), unchanged])


@pytest.mark.parametrize("kind", BAD_SCANS)
def test_a_scan_without_an_answer_is_an_error_alone_and_a_failed_result_in_a_batch(
    kind, of_room, bad_pairs, results_with_bad_pairs
):
    with pytest.raises(novelty.InputError, match="broken"):
        novelty.detect(bad_pairs[kind])
    first, *several, last = results_with_bad_pairs
    failed = several[list(bad_pairs).index(kind)]
    assert failed.status is ResultStatus.FAILED
    assert "broken" in failed.message
    assert failed.added.point_labels.shape == (len(BAD_SCANS[kind]),)
    assert_same(first, of_room)
    assert not last.changed


def test_a_stage_that_breaks_on_one_pair_leaves_the_others(monkeypatch, room, unchanged):
    import novelty.pipeline as pipeline

    genuine = pipeline.register

    def fragile(batch, settings):
        if any(size == num_broken for size in batch.current.num_given):
            raise RuntimeError("a singular matrix, say")
        return genuine(batch, settings)

    broken = ScanPair(room.reference, Scan(room.current.points[:-7], room.current.origin), name="broken")
    num_broken = broken.current.num_points
    monkeypatch.setattr(pipeline, "register", fragile)
    results = novelty.detect_many([room, broken, unchanged])
    assert [result.status is ResultStatus.FAILED for result in results] == [False, True, False]
    assert "a singular matrix" in results[1].message


def odd_clouds() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    return {
        "three points": rng.normal(size=(3, 3)),
        "fewer points than components": rng.normal(size=(12, 3)),
        "coplanar": np.c_[rng.uniform(size=(800, 2)), np.zeros(800)],
        "collinear": np.outer(np.linspace(0, 1, 400), (1.0, 2.0, 0.5)),
        "duplicates": np.repeat(rng.normal(size=(40, 3)), 20, axis=0),
    }


@pytest.mark.parametrize("detector", detector_names())
@pytest.mark.parametrize("kind", odd_clouds())
def test_odd_clouds_still_get_an_answer(kind, detector):
    cloud = odd_clouds()[kind]
    result = novelty.detect(ScanPair(Scan(cloud), Scan(cloud)), Config(detector=detector))
    assert result.status is not ResultStatus.FAILED
    assert result.added.point_states.shape == (len(cloud),)


@pytest.mark.parametrize("detector", detector_names())
def test_everything_cropped_says_so(detector, room):
    config = Config(detector=detector).replace(**{"preprocess.max_height": -100.0})
    result = novelty.detect(room, config)
    assert result.status is ResultStatus.NOTED
    assert not result.changed
    assert (result.added.point_states == 255).all()
    assert "max_height" in result.message


def test_scans_that_hardly_overlap_get_an_answer_with_a_note(room):
    offset = np.array([60.0, 0.0, 0.0])
    away = Scan(room.current.points + offset, room.current.origin + offset)
    result = novelty.detect(ScanPair(room.reference, away))
    assert result.status is ResultStatus.NOTED
    assert "overlap" in result.message


def test_without_origins_the_result_says_that_it_cannot_tell_hidden_from_new(room):
    blind = ScanPair(
        dataclasses.replace(room.reference, origin=None), dataclasses.replace(room.current, origin=None)
    )
    result = novelty.detect(blind)
    assert "origin" in result.message
    assert not np.isin(result.added.point_states, (2, 3)).any()


@pytest.mark.slow
@pytest.mark.data
def test_a_batch_equals_its_pairs_one_by_one_on_real_scans(data_dir):
    entries = novelty.read_pairs(data_dir / "mosd" / "pairs.csv")
    pairs = [entry.load() for entry in entries]
    for pair, result in zip(pairs, novelty.detect_many(pairs), strict=True):
        assert_same(result, novelty.detect(pair))


def test_it_is_said_when_most_of_a_scan_has_changed(room, of_room):
    aside = Scan(room.current.points + np.array([40.0, 0.0, 0.0]), name="aside")
    result = novelty.detect(ScanPair(Scan(room.reference.points), aside))
    assert "100% of the current scan have no counterpart: make sure" in result.message
    assert "have no counterpart" not in of_room.message
