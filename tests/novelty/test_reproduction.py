"""The paper's experiments: what is shared between methods changes no answer, and the page says what the rows say."""

import csv
import dataclasses
import html
import itertools
import math
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch

from novelty import Config, detect_many
from novelty.evaluation import Interval, evaluate
from novelty.reproduction import FAST, Extent, Row, Verdict, reproduce, write_files, write_page, write_rows
from novelty.reproduction import thresholds as reproduction_thresholds
from novelty.reproduction.drawing import Picture, View
from novelty.reproduction.findings import Condition, find, judged
from novelty.reproduction.methods import ALONE, CALIBRATED, CLUSTERINGS, OURS, POINTWISE, PRINTED, STEPS
from novelty.reproduction.rows import interval, order_curve, paired_difference
from novelty.reproduction.scoring import Outcome, SimulatedCase, best_choice, run_experiment
from novelty.reproduction.segmentation import TITLES, SegmentationRow, Segmentations, segment_case
from novelty.reproduction.simplification import run_simplification
from novelty.reproduction.tables import METHODS, spanned, step_table, table_2
from novelty.reproduction.thresholds import ThresholdRow, Thresholds, find_thresholds
from novelty.reproduction.workbench import Workbench
from novelty.scan import CHANGED
from novelty.simulation.experiments import load_experiment

SMALL = {"max_components": 6}


@pytest.fixture(scope="module")
def pairs():
    """Two pairs of the synthetic corridor, in which a box appears."""
    return [member.simulate().scans for member in load_experiment("ideal_corridor").pairs()[:2]]


@pytest.fixture(scope="module")
def bench(pairs):
    return Workbench(pairs)


@pytest.mark.parametrize(
    "method", [*PRINTED, *STEPS, *ALONE, *OURS, CLUSTERINGS[0], *POINTWISE], ids=lambda m: m.key
)
def test_shared_stages_give_the_answers_of_detect(bench, pairs, method):
    answer = bench.answer(method, SMALL)
    expected = detect_many(pairs, method.config.replace(**SMALL))
    for labels, components, result in zip(answer.labels, answer.components, expected, strict=True):
        # What has moved is a matter of both directions, of which only one is looked at here.
        np.testing.assert_array_equal(labels, result.added.point_labels)
        np.testing.assert_array_equal(components, result.added.point_components)


def test_methods_of_one_word_share_their_mixtures_and_others_do_not(bench):
    emd, structural = (bench.answer(method, SMALL) for method in PRINTED)
    assert emd.mixtures is structural.mixtures
    assert bench.answer(ALONE[0], SMALL).mixtures is bench.answer(OURS[0], SMALL).mixtures
    assert bench.answer(ALONE[0], SMALL).mixtures is not emd.mixtures
    assert bench.answer(PRINTED[0], {"max_components": 5}).mixtures is not emd.mixtures


def test_methods_of_one_word_have_the_same_settings_of_the_fit():
    for word, group in itertools.groupby(
        sorted(METHODS.values(), key=lambda m: m.mixtures), lambda m: m.mixtures
    ):
        members = list(group)
        fits = {(m.config.fit, getattr(m.config.chosen_detector, "fits", None)) for m in members}
        assert not word or len(fits) == 1, word


def test_mixtures_of_a_prescribed_order_have_it(bench):
    answers = bench.answers_by_order(PRINTED[0], {}, [2, 4, 6])
    for order, answer in answers.items():
        assert answer.mixtures.num_components.tolist() == [order] * 2
    # The order that MDL chooses is one of those on the way down, with the same mixture.
    chosen = bench.answer(PRINTED[0], SMALL)
    order = int(chosen.mixtures.num_components[0])
    way = bench.answers_by_order(PRINTED[0], {}, [order, 6])[order]
    torch.testing.assert_close(way.mixtures.means[0, :order], chosen.mixtures.means[0, :order])


def test_the_best_choice_of_components_is_the_best_of_all_choices(rng):
    for _ in range(20):
        components, changed = rng.integers(-1, 5, 60), rng.random(60) < 0.3
        changed |= components == 3
        ignored = rng.random(60) < 0.1
        reached = evaluate(changed, best_choice(components, changed, ignored), ignore=ignored).kappa
        subsets = itertools.chain.from_iterable(itertools.combinations(range(5), size) for size in range(6))
        kappas = [evaluate(changed, np.isin(components, list(s)), ignore=ignored).kappa for s in subsets]
        assert reached == pytest.approx(np.nanmax(kappas))


def test_no_change_leaves_no_choice():
    components = np.array([0, 0, 1, -1])
    assert not best_choice(components, np.zeros(4, bool), np.zeros(4, bool)).any()


def test_an_experiment_leaves_a_row_per_pair_and_method_and_a_test():
    outcome = Outcome()
    run_experiment("ideal_corridor", PRINTED, outcome, repetitions=2, tested=[PRINTED])
    assert [(row.method, row.repetition) for row in outcome.rows] == [
        (method.key, repetition) for method in PRINTED for repetition in (0, 1)
    ]
    assert [example.method for example in outcome.examples] == [method.key for method in PRINTED]
    (test,) = outcome.tests
    emd, structural = (
        sum(row.true_positives + row.true_negatives for row in outcome.rows if row.method == method.key)
        for method in PRINTED
    )
    # Who is alone in being right by so many points more, is right by so many points more.
    assert test.first_only - test.second_only == emd - structural
    for row in outcome.rows:
        table = (row.true_positives, row.false_negatives, row.false_positives, row.true_negatives)
        assert row.true_positives + row.false_negatives == row.changed_points
        assert row.chi2 == pytest.approx(sum(table) * row.cramers_v**2)
        assert row.attainable >= row.kappa - 1e-12
        assert math.isnan(row.distance) == (row.method == PRINTED[1].key)


def test_exchanged_scans_find_what_was_removed():
    there, back = Outcome(), Outcome()
    run_experiment("ideal_corridor", PRINTED[:1], there, repetitions=1)
    run_experiment("ideal_corridor", PRINTED[:1], back, repetitions=1, exchanged=True)
    assert there.rows[0].changed_points > 0
    assert back.rows[0].changed_points == 0


def rows_of(kappas, **fixed):
    """One row per kappa, otherwise alike."""
    blank = {field.name: 0 if field.type in ("int", "float") else "" for field in dataclasses.fields(Row)}
    return [
        Row(**{**blank, "repetition": r, "kappa": k, "attainable": 1.0, **fixed})
        for r, k in enumerate(kappas)
    ]


def as_if(good):
    """Rows of all experiments in which the printed methods do as the paper says, or find nothing at all."""
    rows = []
    printed = {"cylinder": 0.25, "person": 0.99, "box": 0.5}
    for method in METHODS.values():
        emd = 0.05 if method.config.detector == "greedy_emd" else 0.0
        for case, kappa in printed.items():
            low = [min(kappa + emd + 0.01 * r, 1.0) if good else 0.001 * r for r in range(10)]
            high = [0.98 + 0.001 * r if good else 0.001 * r for r in range(10)]
            place = {"experiment": "mobile_platform", "case": case, "method": method.key}
            rows += rows_of(low, analysis="complete", attainable=0.4 if good else 1.0, **place)
            rows += rows_of(high, analysis="area of interest", attainable=1.0 if good else 0.2, **place)
        for experiment, cases in (
            ("static_platform", ("door opened", "person", "door closed")),
            ("removal", ("box", "person")),
        ):
            for case in cases:
                place = {"experiment": experiment, "case": case, "method": method.key, "analysis": "K_max 20"}
                rows += rows_of([0.9, 0.95, 0.92] if good else [0.0, 0.1, 0.05], **place)
        for experiment, order in itertools.product(("box_size", "viewpoint"), range(8, 21)):
            kappa = (0.9 if order in (8, 12) else 0.6) if good else 0.05 * (order - 8)
            gap = 0.0 if good else 0.3 * (method is PRINTED[0])
            place = {"experiment": experiment, "case": "box", "method": method.key, "order": order}
            rows += rows_of([kappa + gap, kappa + gap + 0.01], **place)
    seconds = {"fuzzy_automatic": 2.0, "fuzzy_9": 60.0} if good else {"mixture_9": 90.0, "mixture_20": 90.0}
    clusters = {"fuzzy_automatic": 2 if good else 8, "fuzzy_9": 9, "mixture_9": 9, "mixture_20": 20}
    told = {"mixture_20"} if good else {"fuzzy_automatic", "fuzzy_9", "mixture_9"}
    segmentations = [
        SegmentationRow(case, r, key, 100, clusters[key], 0, 9, 5, 0.9 * (key in told), seconds.get(key, 1.0))
        for key in TITLES
        for r in range(10)
        for case in ("door opened", "door closed")
    ]
    maps = [
        ThresholdRow("hall", "box", seed, 9, 0.9, share, share, 0.0)
        for seed, share in enumerate([0.8, 0.81, 0.82, 0.83] if good else [0.1, 0.11, 0.12, 0.13])
    ]
    return rows, segmentations, Thresholds(maps, 3.5, 1.0, 0.09, np.zeros((40, 100)), np.zeros((40, 100)))


def test_numbers_like_the_papers_agree_with_it():
    findings = find(*as_if(good=True))
    assert {finding.claim: finding.verdict for finding in findings} == {
        f.claim: Verdict.AGREES for f in findings
    }
    assert {finding.second_verdict for finding in findings} == {Verdict.AGREES, ""}


def test_the_second_reading_is_judged_by_its_own_rows():
    rows, segmentations, thresholds = as_if(good=True)
    bad, *_ = as_if(good=False)
    mixed = [row for row in rows if row.method != CALIBRATED.key]
    mixed += [row for row in bad if row.method == CALIBRATED.key]
    (alike,) = [f for f in find(mixed, segmentations, thresholds) if f.claim.startswith("Below 1.5 m")]
    assert (alike.verdict, alike.second_verdict) == (Verdict.AGREES, Verdict.PARTLY)


def test_methods_that_find_nothing_agree_with_nothing():
    findings = find(*as_if(good=False))
    agreeing = [finding.claim for finding in findings if finding.verdict is Verdict.AGREES]
    assert not agreeing
    assert Verdict.DIFFERS in {finding.verdict for finding in findings}


def test_one_repetition_decides_nothing_about_means():
    rows, segmentations, thresholds = as_if(good=True)
    findings = find([row for row in rows if row.repetition == 0], segmentations, thresholds)
    (person,) = [f for f in findings if "the person is found far better" in f.claim]
    assert person.verdict is Verdict.OPEN


@pytest.mark.parametrize(
    ("span", "bounds", "holds"),
    [
        ((0.7, 0.65, 0.75), {"low": 0.6}, True),
        ((0.7, 0.55, 0.85), {"low": 0.6}, None),
        ((0.5, 0.45, 0.6), {"low": 0.6}, False),
        ((0.5, 0.4, 0.55), {"high": 0.6}, True),
        ((0.01, -0.05, 0.07), {"low": -0.1, "high": 0.1}, True),
        ((0.09, 0.05, 0.13), {"low": -0.1, "high": 0.1}, None),
        ((0.3, 0.2, 0.4), {"low": -0.1, "high": 0.1}, False),
        ((0.9, math.nan, math.nan), {"low": 0.6}, None),
    ],
)
def test_a_condition_holds_when_its_interval_does(span, bounds, holds):
    condition = Condition("κ", Interval(*span, 5), **bounds)
    assert condition.holds is holds
    assert str(condition).startswith(f"κ {span[0]:.2f}")


@pytest.mark.parametrize(
    ("spans", "verdict"),
    [
        (((0.7, 0.65, 0.75), (0.9, 0.8, 1.0)), Verdict.AGREES),
        (((0.7, 0.65, 0.75), (0.1, 0.0, 0.2)), Verdict.PARTLY),
        (((0.1, 0.0, 0.2), (0.6, 0.5, 0.7)), Verdict.DIFFERS),
        (((0.6, 0.5, 0.7), (0.6, 0.5, 0.7)), Verdict.OPEN),
    ],
)
def test_a_verdict_needs_something_that_is_decided(spans, verdict):
    assert judged([Condition("κ", Interval(*span, 5), low=0.6) for span in spans]) is verdict


def test_thresholds_of_least_error_come_from_labelled_maps(monkeypatch):
    monkeypatch.setattr(reproduction_thresholds, "TRAINING", ("ideal_corridor",))
    found = find_thresholds(2)
    assert [(row.scene, row.case, row.seed) for row in found.rows] == [
        ("ideal_corridor", "box", 0),
        ("ideal_corridor", "box", 1),
    ]
    for row in found.rows:
        assert 0 <= row.valid <= min(row.near, row.alike) + 1e-12
        assert row.valid_pairings >= 2
        assert found.error <= row.error + 0.2
    # What is let pass at the thresholds found is the corner of the histograms.
    node, arc = (np.searchsorted(*ends) for ends in zip(found.bins, (found.node, found.arc), strict=True))
    corner = [histogram[:node, :arc].sum() for histogram in (found.valid, found.invalid)]
    assert found.error == pytest.approx((corner[1] + 1 - corner[0]) / 2)
    assert (found.method.config.structural_matching.node_threshold, found.method.mixtures) == (
        found.node,
        "printed",
    )


def test_what_was_found_can_be_used():
    none = np.zeros((0, 0))
    preset = Config.preset("paper_calibrated").structural_matching
    found = Thresholds([], preset.node_threshold, preset.arc_threshold, 0.1, none, none)
    assert found.options == "--preset paper_calibrated"
    other = dataclasses.replace(found, arc=0.3)
    assert other.options == (
        f"--preset paper_calibrated --set structural_matching.node_threshold={found.node:g} "
        "--set structural_matching.arc_threshold=0.3"
    )
    assert other.method.config.structural_matching.arc_threshold == 0.3


def test_segmentations_are_those_of_the_first_scans(bench, pairs):
    members = load_experiment("ideal_corridor").pairs()[:2]
    found = Segmentations()
    segment_case(SimulatedCase("ideal_corridor", members, bench), found, 1)
    assert [row.method for row in found.rows] == list(TITLES)
    assert {row.repetition for row in found.rows} == {0}
    clusters = {row.method: row.clusters for row in found.rows}
    assert clusters["fuzzy_9"] == 9
    chosen = {row.method: (row.by_hypervolume, row.by_average_density) for row in found.rows}
    assert min(chosen["fuzzy_automatic"]) >= 1
    assert chosen["fuzzy_9"] == chosen["mixture_20"] == (0, 0)
    assert 1 < clusters["mixture_9"] <= 9
    assert 1 < clusters["mixture_20"] <= 20
    assert [len(example.clusters) for example in found.examples] == [row.points for row in found.rows]


def test_curved_ground_keeps_more_points_than_flat():
    rows, example = run_simplification(Outcome(), 2)
    assert 0.05 < len(example.kept) / len(example.points) < 0.5
    (first, *_) = [row for row in rows if row.max_surface_variation == 0.001]
    assert first.kept_curved > 2 * first.kept_flat > 0
    assert first.kept_flat < first.kept < first.kept_curved
    kept = [row.kept for row in rows if row.repetition == 0]
    assert kept == sorted(kept, reverse=True)


def test_an_order_curve_is_the_mean_over_maps():
    rows, *_ = as_if(good=True)
    curve = order_curve(rows, "viewpoint", PRINTED[0])
    assert list(curve) == list(range(8, 21))
    assert curve[8].mean == pytest.approx(0.905)
    assert curve[9].mean == pytest.approx(0.605)


def test_differences_are_taken_pair_by_pair():
    first, second = rows_of([0.9, 0.5, 0.1]), rows_of([0.8, 0.4, 0.0])
    span = paired_difference(first, second[::-1], ("case", "repetition"))
    assert (span.mean, span.count) == (pytest.approx(0.1), 3)
    assert span.half_width == pytest.approx(0, abs=1e-12)
    assert interval(first).half_width > 0.5


def test_printed_values_stand_beside_the_printed_methods_only():
    rows, *_ = as_if(good=True)
    table = table_2(rows, "complete")
    beside = {(row.cells[0], row.cells[1]): row.cells[-1] for row in table.rows}
    assert beside["cylinder", "EMD, as printed"] == "0.570, 0.381, 0.254"
    assert beside["box", "Str. matching, as printed"] == "0.543, 0.479, 0.465"
    assert beside["person", "EMD, ours"] == ""
    assert len(step_table(rows).rows) == len([m for m in METHODS if m.startswith(("emd", "structural"))])


@pytest.mark.parametrize(
    ("span", "text"),
    [
        (Interval(0.5, 0.4, 0.6, 10), "0.500 [0.400, 0.600]"),
        (Interval(0.5, math.nan, math.nan, 1), "0.500"),
        (Interval(math.nan, math.nan, math.nan, 0), "–"),
    ],
)
def test_intervals_are_told_as_far_as_they_are_defined(span, text):
    assert spanned(span) == text


def test_intervals_stay_within_what_kappa_can_be():
    wide, one = interval(rows_of([-0.9, 1.0])), interval(rows_of([0.5]))
    assert (wide.low, wide.high) == (-1, 1)
    assert math.isnan(one.low)
    gap = paired_difference(rows_of([1.0, -1.0]), rows_of([-1.0, 1.0]), ("repetition",))
    assert (gap.low, gap.high) == (-2, 2)


def test_rows_are_the_same_as_csv_and_as_parquet(tmp_path):
    rows = rows_of([0.25, math.nan, 0.75], case="box", method="emd")
    write_rows(tmp_path, "rows", rows)
    with (tmp_path / "rows.csv").open(encoding="utf-8") as stream:
        read = list(csv.DictReader(stream))
    assert [row["kappa"] for row in read] == ["0.25", "", "0.75"]
    table = pq.read_table(tmp_path / "rows.parquet").to_pylist()
    assert [row["method"] for row in table] == ["emd"] * 3
    assert math.isnan(table[1]["kappa"])
    assert list(read[0]) == list(table[0]) == [field.name for field in dataclasses.fields(Row)]


def test_an_ellipse_is_drawn_where_its_points_are(rng):
    pytest.importorskip("matplotlib")
    from gmmtorch import GaussianMixtures

    points = rng.normal(size=(4000, 3)) * (3.0, 1.0, 0.5) + (10.0, 0, 0)
    view = View.from_corner(points, cut_ceiling=False)
    mixture = GaussianMixtures.from_arrays([1.0], points.mean(0)[None], np.cov(points.T)[None])
    picture = Picture(view).points(points, "#000000").ellipses(mixture, {0: "#ff0000"})
    (patch,) = picture._axes.patches
    inside = patch.get_path().transformed(patch.get_patch_transform()).contains_points(view.project(points))
    # 1.5 standard deviations of a Gaussian in the plane.
    assert inside.mean() == pytest.approx(1 - math.exp(-(1.5**2) / 2), abs=0.03)
    assert picture.encoded(points, "png").startswith(b"\x89PNG")


def test_the_fast_extent_is_a_part_of_the_whole():
    from novelty.reproduction import FULL

    assert all(a < b for a, b in zip(dataclasses.astuple(FAST), dataclasses.astuple(FULL), strict=True))


@pytest.mark.slow
def test_the_page_stands_alone_and_says_what_the_rows_say(tmp_path):
    pytest.importorskip("matplotlib")
    extent = Extent(repetitions=1, maps=2, segmentations=1, training=1)
    said = []
    found = reproduce(extent, said.append)
    write_files(tmp_path, found)
    write_page(tmp_path / "paper.html", found, extent, "novelty paper")
    text = (tmp_path / "paper.html").read_text(encoding="utf-8")
    assert not re.search(r"<(link|script|img)\s[^>]*(src|href)=\"?http", text.split("<script>")[0])
    plain = re.sub(r"<sub>(\w+)</sub>", r"_\1", text).replace("&nbsp;", " ")
    for finding in found.findings:
        for told in (finding.ours, finding.decides):
            for part in told.split("; "):
                assert html.escape(part).replace("&#x27;", "&#39;") in plain
    for heading in (
        "Table 2",
        "Fig. 4",
        "Fig. 5",
        "Fig. 11",
        "Fig. 12",
        "Fig. 13",
        "Fig. 15",
        "Fig. 16",
        "Fig. 17",
        "Fig. 18",
    ):
        assert heading in text
    assert len(said) == len(found.seconds)
    rows = pq.read_table(tmp_path / "rows.parquet").to_pylist()
    assert len(rows) == len(found.outcome.rows)
    assert {row["experiment"] for row in rows} >= {
        "mobile_platform",
        "static_platform",
        "box_size",
        "viewpoint",
    }
    changed = [example for example in found.outcome.examples if (example.scan.labels == CHANGED).any()]
    assert changed
    assert Config.preset("paper").structural_matching.node_threshold == 3.5
