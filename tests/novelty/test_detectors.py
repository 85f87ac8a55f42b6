"""What every detector promises: no change no novelty, a new blob is found, roles and batches do not matter."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from gmmtorch import GaussianMixtures
from novelty import Config, ConfigError
from novelty.detectors import (
    Comparison,
    ComponentNovelty,
    Detector,
    GreedyEmd,
    JointMixture,
    Likelihood,
    StructuralMatching,
    UnbalancedEmd,
)
from novelty.fitting import Fit, FitPlan, Models
from novelty.preprocess import PreparedPairs, Preprocess, prepare
from novelty.scan import Scan

DETECTORS = [
    Likelihood(),
    GreedyEmd(),
    GreedyEmd(fits="independent"),
    StructuralMatching(),
    UnbalancedEmd(),
    JointMixture(),
]
"""A new detector joins every test below by one line."""

PLAN = FitPlan(settings=Fit(initializer="kmeans++"), max_components=7, seed=0)
FAR_AWAY = np.array([5e5, 4e6, 100.0])
BOX_CENTRE = np.array([0.6, 1.0, 0.35])

each_detector = pytest.mark.parametrize(
    "detector", DETECTORS, ids=lambda d: f"{type(d).__name__}-{getattr(d, 'fits', '')}"
)

each_steady_detector = pytest.mark.parametrize(
    "detector",
    [d for d in DETECTORS if getattr(d, "fits", "coupled") != "independent"],
    ids=lambda d: type(d).__name__,
)
"""Two independent fits may cut a wall in two ways, which a comparison of components takes for novelty."""


def room(seed: int, box: bool = False, sofa: bool = True) -> np.ndarray:
    """Two walls, a shelf and a sofa with 5 mm of noise; with `box`, a ball of points in the empty middle."""
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, 800))
    parts = [
        np.stack([3 * u, 0 * u, 2 * v], axis=1),
        np.stack([0 * u, 3 * u, 2 * v], axis=1),
        [2.5, 2.5, 1.0] + rng.normal(size=(500, 3)) * [0.1, 0.1, 0.3],
    ]
    if sofa:
        parts.append([2.2, 0.7, 0.3] + rng.normal(size=(500, 3)) * [0.3, 0.1, 0.1])
    if box:
        parts.append(BOX_CENTRE + rng.normal(size=(400, 3)) * 0.07)
    return np.concatenate(parts) + rng.normal(size=(sum(map(len, parts)), 3)) * 0.005


def pairs(*scans: tuple[np.ndarray, np.ndarray]) -> PreparedPairs:
    settings = Preprocess(outliers="none", ground="none")
    references, currents = (
        prepare([Scan(points) for points in side], settings) for side in zip(*scans, strict=True)
    )
    return PreparedPairs(reference=references, current=currents)


def judged(detector: Detector, batch: PreparedPairs) -> tuple[Models, Comparison]:
    models = detector.fit(batch, PLAN)
    return models, detector.compare(batch, models)


@cache
def with_box() -> PreparedPairs:
    """A pair in whose current scan the box has come."""
    return pairs((room(0), room(1, box=True)))


@cache
def judged_with_box(detector: Detector) -> tuple[Models, Comparison]:
    return judged(detector, with_box())


def novel_points(novelty: ComponentNovelty, batch: PreparedPairs, models: Models) -> np.ndarray:
    points = batch.current.points
    components = models.current.mixtures.assign(points)
    return novelty.novel[points.cloud_index, components].numpy()


@each_steady_detector
def test_one_place_measured_twice_shows_no_novelty(detector):
    batch = pairs((room(0), room(1)))
    models, comparison = judged(detector, batch)
    assert novel_points(comparison.added, batch, models).mean() < 0.01
    assert novel_points(comparison.removed, batch.exchanged(), models.exchanged()).mean() < 0.01


@each_detector
def test_the_same_mixture_twice_shows_no_novelty(detector):
    batch = pairs((room(0), room(0)))
    models, _ = judged(detector, batch)
    same = Models(reference=models.current, current=models.current)
    comparison = detector.compare(batch, same)
    assert not comparison.added.novel.any()
    assert not comparison.removed.novel.any()
    present = models.current.mixtures.mask
    own = torch.arange(present.shape[1]).expand_as(present)
    assert torch.equal(comparison.added.matches[present], own[present])
    torch.testing.assert_close(comparison.added.distances[present], torch.zeros_like(own[present]).double())


@each_detector
def test_an_inserted_blob_is_found(detector):
    batch = with_box()
    models, comparison = judged_with_box(detector)
    inserted = (batch.current.points.points - torch.from_numpy(BOX_CENTRE)).norm(dim=1).numpy() < 0.25
    found = novel_points(comparison.added, batch, models)
    assert found[inserted].mean() > 0.95


@each_steady_detector
def test_nothing_but_the_inserted_blob_is_novel(detector):
    batch = with_box()
    models, comparison = judged_with_box(detector)
    inserted = (batch.current.points.points - torch.from_numpy(BOX_CENTRE)).norm(dim=1).numpy() < 0.25
    assert novel_points(comparison.added, batch, models)[~inserted].mean() < 0.01
    assert novel_points(comparison.removed, batch.exchanged(), models.exchanged()).mean() < 0.01


@each_detector
def test_scores_order_the_blob_above_the_rest(detector):
    models, comparison = judged_with_box(detector)
    distance = (models.current.mixtures.means[0] - torch.from_numpy(BOX_CENTRE)).norm(dim=1)
    blob = int(distance.argmin())
    scores = comparison.added.scores[0]
    assert scores[blob] == scores[models.current.mixtures.mask[0]].max()
    assert comparison.added.reasons[0][blob].startswith("Novel")


@each_detector
def test_exchanged_roles_exchange_the_answer(detector):
    batch = pairs((room(0), room(1, box=True)), (room(2, box=True), room(3, sofa=False)))
    models, forth = judged(detector, batch)
    back = detector.compare(batch.exchanged(), models.exchanged())
    assert torch.equal(forth.added.novel, back.removed.novel)
    assert torch.equal(forth.removed.novel, back.added.novel)
    torch.testing.assert_close(forth.added.scores, back.removed.scores, equal_nan=True)
    torch.testing.assert_close(forth.distance, back.distance, equal_nan=True)


@each_detector
def test_a_batch_equals_its_pairs_one_by_one(detector):
    scans = [(room(0), room(1, box=True)), (room(2)[::3], room(3, sofa=False)), (room(4, box=True), room(5))]
    together = judged(detector, pairs(*scans))[1]
    for p, scan in enumerate(scans):
        alone = judged(detector, pairs(scan))[1]
        for one, many in ((alone.added, together.added), (alone.removed, together.removed)):
            k = one.novel.shape[1]
            assert torch.equal(one.novel[0], many.novel[p, :k])
            assert not many.novel[p, k:].any()
            torch.testing.assert_close(one.scores[0], many.scores[p, :k], equal_nan=True)
            assert one.reasons[0] == many.reasons[p]
        assert alone.notes[0] == together.notes[p]


@each_detector
def test_without_one_side_nothing_is_novel_and_a_note_says_why(detector):
    nothing = np.full((4, 3), np.nan)
    batch = pairs((nothing, room(0)), (room(1), nothing), (room(0), room(1, box=True)))
    models, comparison = judged(detector, batch)
    for novelty in (comparison.added, comparison.removed):
        assert not novelty.novel[:2].any()
        assert novelty.scores[:2].isnan().all()
        assert (novelty.matches[:2] == -1).all()
    assert "reference" in comparison.notes[0][0]
    assert "current" in comparison.notes[1][0]
    assert comparison.notes[2] == ()
    assert comparison.added.novel[2].any()
    assert [len(r) for r in comparison.added.reasons] == models.current.mixtures.num_components.tolist()


@each_detector
def test_single_components_are_compared(detector):
    blob = np.random.default_rng(0).normal(size=(500, 3))
    batch = pairs((blob, blob + 0.01), (blob, blob + 100.0))
    plan = replace(PLAN, max_components=1)
    comparison = detector.compare(batch, detector.fit(batch, plan))
    assert not comparison.added.novel[0].any()
    # Algorithm 2 never removes the last component.
    assert isinstance(detector, GreedyEmd) != bool(comparison.added.novel[1, 0])


@each_detector
def test_unit_and_place_of_the_scene_do_not_matter(detector):
    here = (room(0), room(1, box=True))
    batch = pairs(here, tuple(points + FAR_AWAY for points in here), tuple(40 * p for p in here))
    models, comparison = judged(detector, batch)
    labels = batch.current.points.split(torch.from_numpy(novel_points(comparison.added, batch, models)))
    for other in labels[1:]:
        assert (labels[0] == other).float().mean() > 0.999


@pytest.mark.parametrize("ground_distance", ["hellinger", "mean", "bures", "combined"])
def test_greedy_emd_reports_the_distance_of_eq_8(ground_distance):
    detector = GreedyEmd(ground_distance=ground_distance)
    batch = pairs((room(0), room(1)), (room(0), room(1, box=True)))
    _, comparison = judged(detector, batch)
    assert 0 < comparison.distance[0] < comparison.distance[1]


def test_structural_matching_in_metres_is_the_papers():
    batch = pairs((room(0), room(0)))
    models, comparison = judged(StructuralMatching(scale="metre"), batch)
    assert not comparison.added.novel.any()
    assert (comparison.added.matches[models.current.mixtures.mask] >= 0).all()


@pytest.mark.parametrize(
    ("settings", "alike"),
    [
        # d_Sigma is 8.0 in one mixture and 8.1 in the other: w = 1.27 as printed, 0.32 without the squares.
        ({"scale": "metre", "arc_terms": "squared", "arc_threshold": 1.26}, False),
        ({"scale": "metre", "arc_terms": "squared", "arc_threshold": 1.27}, True),
        ({"scale": "metre", "arc_terms": "plain", "arc_threshold": 0.31}, False),
        ({"scale": "metre", "arc_terms": "plain", "arc_threshold": 0.32}, True),
        # Relative to the distances: w^2 = 1.61 / (1 + 129.61 / 2), and 0.1 / (1 + 16.1 / 2).
        ({"scale": "component", "arc_terms": "squared", "arc_threshold": 0.15}, False),
        ({"scale": "component", "arc_terms": "squared", "arc_threshold": 0.16}, True),
        ({"scale": "component", "arc_terms": "plain", "arc_threshold": 0.10}, False),
        ({"scale": "component", "arc_terms": "plain", "arc_threshold": 0.11}, True),
    ],
)
def test_both_readings_of_equation_12(settings, alike):
    def mixture(shapes_apart):
        # In one place, so that only shapes differ: d_Sigma = 8.0 of exp(8 / sqrt 3) I and I (eq. 10).
        covariances = np.stack([np.eye(3), np.exp(shapes_apart / 3**0.5) * np.eye(3)])
        return GaussianMixtures.from_arrays(np.full((1, 2), 0.5), np.zeros((1, 2, 3)), covariances[None])

    batch = pairs((room(0), room(1)))
    models = StructuralMatching().fit(batch, FitPlan(Fit(), 2))
    models = replace(
        models,
        reference=replace(models.reference, mixtures=mixture(8.0)),
        current=replace(models.current, mixtures=mixture(8.1)),
    )
    detector = StructuralMatching(resolution_floor="none", **settings)
    told = detector.compare(batch, models).added
    assert (told.matches[0] >= 0).sum().item() == (2 if alike else 1)


def test_a_reading_that_is_none_is_refused():
    with pytest.raises(ConfigError, match=r"arc_terms.*'squared' or 'plain'"):
        Config().replace(**{"structural_matching.arc_terms": "cubed"})


def test_a_search_that_ran_out_of_budget_says_so():
    batch = pairs((room(0), room(1, box=True)))
    detector = StructuralMatching(node_budget=1, node_threshold=100.0)
    comparison = judged(detector, batch)[1]
    assert "Not proven maximal" in comparison.notes[0][0]


def test_a_few_straddling_cells_are_no_evidence():
    batch = pairs((room(0), room(1, box=True)))
    models, comparison = judged(Likelihood(min_cells=10_000), batch)
    assert not comparison.added.novel.any()
    assert (comparison.added.scores[models.current.mixtures.mask] <= 0).all()


def test_likelihood_points_agree_with_their_components():
    batch = with_box()
    _, comparison = judged_with_box(Likelihood())
    scores = comparison.added.point_scores.numpy()
    inserted = (batch.current.points.points - torch.from_numpy(BOX_CENTRE)).norm(dim=1).numpy() < 0.25
    assert scores.shape == inserted.shape
    assert (scores[inserted] > 0).mean() > 0.9
    assert (scores[~inserted] > 0).mean() < 0.01
    assert comparison.p_value[0] < 0.1
    p_values = comparison.added.p_values[comparison.added.novel]
    assert (p_values <= Likelihood().false_discovery_rate).all()


@pytest.mark.parametrize(("merging", "novel"), [(True, [False, False, False]), (False, [False, False, True])])
def test_structural_matching_joins_what_an_independent_fit_cut_apart(merging, novel):
    wall, floor = np.diag([1.0, 0.01, 0.5]), np.diag([2.0, 1.5, 0.01])
    offset = np.array([np.sqrt(2 / np.pi), 0.0, 0.0])  # of the mean of one half of the wall
    half = wall - np.outer(offset, offset)
    place = np.array([0.0, 3.0, 1.0])
    whole = GaussianMixtures.from_arrays(
        [[0.5, 0.5]], np.stack([place, 0 * place])[None], np.stack([wall, floor])[None]
    )
    halves = GaussianMixtures.from_arrays(
        [[0.25, 0.5, 0.25]],
        np.stack([place - offset, 0 * place, place + offset])[None],
        np.stack([half, floor, half])[None],
    )
    detector = StructuralMatching(
        fits="independent", merging=merging, node_threshold=1.5, resolution_floor="none"
    )
    batch = pairs((room(0), room(1)))
    models = detector.fit(batch, FitPlan(Fit(), 3))
    models = Models(replace(models.reference, mixtures=whole), replace(models.current, mixtures=halves))
    told = detector.compare(batch, models)
    assert told.added.novel[0].tolist() == novel
    assert told.removed.novel[0].tolist() == [False, False]
    if merging:
        assert told.added.matches[0].tolist() == [0, 1, 0]
        assert told.removed.matches[0].tolist() == [0, 1]
        assert told.added.reasons[0][0].endswith("Joined with component 2 of its own mixture.")
