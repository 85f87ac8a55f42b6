import builtins
import logging
from functools import cache

import numpy as np
import pytest

from novelty import Config, MissingDependencyError, PointState, Scan, ScanPair, detect, detect_many
from novelty.baselines import M3C2, FuzzyPartition, KMeansMixture, NearestNeighbour, VoxelDifference
from novelty.config import baseline_names, detector_names

CASES = {
    "nearest_neighbour": NearestNeighbour(distance=0.06),
    "voxel_difference": VoxelDifference(voxel_size=0.1),
    "m3c2": M3C2(cylinder_radius=0.1, normal_radius=0.2, core_spacing=0.05, max_distance=0.3),
}
"""Every baseline that compares points, with parameters that fit the scene below."""

MIXTURE_CASES = {
    "kmeans_mixture": KMeansMixture(),
    "fuzzy_partition": FuzzyPartition(validity="none", max_clusters=4),
}
"""Every baseline that compares clusters."""


@pytest.fixture(params=CASES)
def baseline(request):
    if request.param == "m3c2":
        pytest.importorskip("py4dgeo", reason="the extra [baselines] is not installed")
    return request.param


def wall_and_box(seed, box):
    """A wall of 3 m x 2 m, 1 m to the side of the sensor; with `box`, a 0.4 m box stands 0.5 m before it."""
    rng = np.random.default_rng(seed)
    wall = np.stack([rng.uniform(0, 3, 6000), rng.normal(0, 0.003, 6000), rng.uniform(0, 2, 6000)], axis=1)
    front = np.stack(
        [rng.uniform(1, 1.4, 800), rng.normal(0.6, 0.003, 800), rng.uniform(1, 1.4, 800)], axis=1
    )
    return np.concatenate([wall, front]) if box else wall


@pytest.fixture(scope="module")
def pair():
    """The box is there in the current scan only; the sensor of the reference looked from in front."""
    origin = np.array([1.5, 4.0, 1.0])
    return ScanPair(Scan(wall_and_box(1, False), origin), Scan(wall_and_box(2, True), origin), "box")


def config_of(name, **changes):
    return Config(detector=name, max_components=6, **{name: (CASES | MIXTURE_CASES)[name]}).replace(
        **{
            "registration.method": "none",
            "preprocess.outliers": "none",
            "preprocess.ground": "none",
            **changes,
        }
    )


@pytest.fixture(scope="module")
def found(pair):
    """What a baseline finds in the pair."""
    return cache(lambda name: detect(pair, config_of(name)))


def test_every_baseline_is_under_test():
    assert set(CASES) | set(MIXTURE_CASES) == set(baseline_names())
    assert not set(baseline_names()) & set(detector_names())


def test_finds_the_box_and_nothing_else(baseline, pair, found):
    result = found(baseline)
    box = np.arange(pair.current.num_points) >= 6000
    assert result.added.point_labels[box].mean() > 0.95
    assert result.added.point_labels[~box].mean() < 0.01
    assert result.removed.point_labels.mean() < 0.01


def test_roles_exchanged_exchange_the_answer(baseline, pair, found):
    there = found(baseline)
    back = detect(ScanPair(pair.current, pair.reference), config_of(baseline))
    np.testing.assert_array_equal(there.added.point_labels, back.removed.point_labels)
    np.testing.assert_array_equal(there.removed.point_labels, back.added.point_labels)


def test_a_batch_equals_its_pairs_alone(baseline, pair):
    pairs = [pair, ScanPair(pair.current, pair.reference), ScanPair(pair.reference, pair.reference)]
    for one, result in zip(pairs, detect_many(pairs, config_of(baseline)), strict=True):
        alone = detect(one, config_of(baseline))
        np.testing.assert_array_equal(result.added.point_scores, alone.added.point_scores)
        np.testing.assert_array_equal(result.removed.point_labels, alone.removed.point_labels)


def test_the_same_scan_twice_is_unchanged(baseline, pair):
    result = detect(ScanPair(pair.current, pair.current), config_of(baseline))
    assert not result.changed
    assert not result.added.objects


def test_travels_without_mixtures(baseline, found):
    result = found(baseline)
    assert result.added.components == ()
    assert (result.added.point_components == -1).all()
    assert (result.added.point_states != PointState.NOT_EXAMINED).all()
    assert np.isnan(result.p_value)
    largest = result.added.objects[0]
    assert largest.components == ()
    assert largest.neighbours == ()
    np.testing.assert_allclose(largest.centroid, (1.2, 0.6, 1.2), atol=0.05)
    assert result.details["current"]["num_components"] == 0


def test_neither_refined_nor_cleared_of_specks(baseline, pair):
    plain = detect(pair, config_of(baseline, **{"refine.method": "none"}))
    asked = detect(pair, config_of(baseline, **{"refine.method": "surface", "segment.min_points": 10_000}))
    np.testing.assert_array_equal(plain.added.point_labels, asked.added.point_labels)


def test_visibility_judges_only_when_asked(baseline):
    origin = np.array([1.5, 4.0, 1.0])
    # The current scan shows what stood behind the box of the reference: hidden there, not new.
    shadow = np.random.default_rng(5).uniform((1.1, 0.3, 1.1), (1.3, 0.3, 1.3), (500, 3))
    reference, current = wall_and_box(1, True), np.concatenate([wall_and_box(2, False), shadow])
    # No ray of the reference went on behind its box, whose shadow on the wall is wider than the box.
    behind = (np.abs(reference[:, [0, 2]] - 1.2) < 0.35).all(axis=1) & (reference[:, 1] < 0.3)
    reference = reference[~behind]
    pair = ScanPair(Scan(reference, origin), Scan(current, origin))
    plain = detect(pair, config_of(baseline)).added.point_states[-500:]
    judged = detect(pair, config_of(baseline, **{f"{baseline}.visibility": True})).added.point_states[-500:]
    assert (plain == PointState.NOVEL).mean() > 0.9
    assert (judged == PointState.OCCLUDED).mean() > 0.9


def test_an_empty_side_is_told_and_nothing_is_novel(baseline, pair):
    high = {"preprocess.min_height": 5.0}
    lifted = Scan(np.add(pair.current.points, (0, 0, 10.0)))
    result = detect(ScanPair(pair.reference, lifted), config_of(baseline, **high))
    assert not result.changed
    assert "nothing can be called added" in result.message
    assert np.isnan(result.added.point_scores).all()


def test_nearest_neighbour_equals_all_distances(rng):
    points, others = rng.normal(size=(50, 3)), rng.normal(size=(70, 3))
    expected = np.linalg.norm(points[:, None] - others[None], axis=2).min(axis=1)
    np.testing.assert_allclose(NearestNeighbour().scores(points, others), expected, rtol=1e-12)


def test_voxel_difference_equals_sets_of_voxels(rng):
    points, others = rng.normal(size=(200, 3)), rng.normal(size=(300, 3))
    occupied = {tuple(voxel) for voxel in np.floor(others / 0.4).astype(int)}
    expected = [tuple(voxel) not in occupied for voxel in np.floor(points / 0.4).astype(int)]
    assert 0.1 < np.mean(expected) < 0.9
    np.testing.assert_array_equal(VoxelDifference(voxel_size=0.4).scores(points, others), expected)


def test_voxel_difference_spans_any_extent(rng):
    points = np.concatenate([rng.normal(size=(10, 3)), [[1e9, -1e9, 1e9]]])
    assert VoxelDifference(voxel_size=0.01).scores(points, points[:10]).tolist() == [0.0] * 10 + [1.0]


def test_m3c2_measures_the_shift_of_a_plane(rng):
    pytest.importorskip("py4dgeo", reason="the extra [baselines] is not installed")
    plane = np.concatenate([rng.uniform(0, 1, (4000, 2)), rng.normal(0, 1e-3, (4000, 1))], axis=1)
    method = M3C2(cylinder_radius=0.1, normal_radius=0.1, registration_error=0.0, max_distance=0.2)
    inside = (np.abs(plane[:, :2] - 0.5) < 0.3).all(axis=1)
    scores = method.scores(plane[inside], np.add(plane, (0, 0, 0.05)))
    # The level of detection of some hundred points with a noise of 1 mm is a tenth of a millimetre.
    np.testing.assert_allclose(scores, 0.05, atol=2e-3)
    assert (method.scores(plane[inside], np.add(plane, (0, 0, 1.0))) == 0.2).all()


def test_m3c2_is_quiet(pair, tmp_path, monkeypatch, capfd):
    pytest.importorskip("py4dgeo", reason="the extra [baselines] is not installed")
    monkeypatch.chdir(tmp_path)
    CASES["m3c2"].scores(pair.current.points[:500], pair.reference.points)
    logging.getLogger("py4dgeo").error("something to say")
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


def test_m3c2_names_its_extra_where_it_is_missing(pair, monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith("py4dgeo"):
            raise ImportError("No module named 'py4dgeo'")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingDependencyError, match=r"pip install 'novelty-gmm\[baselines\]'"):
        detect(pair, config_of("m3c2"))


@pytest.fixture(params=MIXTURE_CASES)
def clustering(request):
    return request.param


def test_clusters_find_the_box(clustering, pair, found):
    result = found(clustering)
    box = np.arange(pair.current.num_points) >= 6000
    assert result.added.point_labels[box].mean() > 0.9
    assert any(record.novel for record in result.added.components)


def test_clusters_in_a_batch_equal_their_pairs_alone(clustering, pair):
    pairs = [pair, ScanPair(pair.current, pair.reference), ScanPair(pair.reference, pair.reference)]
    for one, result in zip(pairs, detect_many(pairs, config_of(clustering)), strict=True):
        alone = detect(one, config_of(clustering))
        np.testing.assert_array_equal(result.added.point_components, alone.added.point_components)
        np.testing.assert_array_equal(result.removed.point_labels, alone.removed.point_labels)


def test_clusters_are_scored_plain(clustering, pair):
    plain = detect(pair, config_of(clustering, **{"refine.method": "none"}))
    asked = detect(pair, config_of(clustering, **{"refine.method": "surface"}))
    np.testing.assert_array_equal(plain.added.point_labels, asked.added.point_labels)


def test_clusters_of_an_empty_side(clustering, pair):
    lifted = Scan(np.add(pair.current.points, (0, 0, 10.0)))
    result = detect(ScanPair(pair.reference, lifted), config_of(clustering, **{"preprocess.min_height": 5.0}))
    assert not result.changed
    assert "nothing can be called added" in result.message


def test_as_many_kmeans_clusters_as_asked_and_no_more_than_points(pair, found):
    result = found("kmeans_mixture")
    assert len(result.added.components) == 6
    assert sum(record.num_points for record in result.added.components) == pair.current.num_points
    few = Scan(pair.current.points[[0, 3000, 6000]])
    assert len(detect(ScanPair(few, few), config_of("kmeans_mixture")).added.components) <= 3
