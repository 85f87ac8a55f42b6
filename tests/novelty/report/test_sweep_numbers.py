"""What a report says about a sweep equals what a plain calculation over its rows gives."""

import json

import numpy as np
import pandas as pd
import pytest

from novelty import InputError
from novelty.evaluation.intervals import bootstrap_interval
from novelty.report.sweep import SweepRuns
from novelty.report.sweep.comparison import compare
from novelty.report.sweep.costs import costs
from novelty.report.sweep.extremes import extremes
from novelty.report.sweep.failures import failures, remarks
from novelty.report.sweep.orders import orders
from novelty.report.sweep.studies import series_factor, studies
from novelty.report.sweep.summary import summarise
from novelty.sweep import SweepFolder
from novelty.sweep.rows import STAGES
from novelty.sweep.store import RowStore
from tests.novelty.report.sweep_case import DETECTORS, make_sweep


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A sweep over K_max, an option of the simulation and a configuration key; the runs of pair 5 fail."""
    folder = tmp_path_factory.mktemp("sweep")
    conditions = ({"pose_error": 0.0, "case": "door"}, {"pose_error": 0.1, "case": "door"}, {"case": "still"})
    rows = make_sweep(
        folder,
        detectors=DETECTORS[:2],
        axes={"fit.initializer": ["random", "merged"]},
        conditions=conditions,
        failing=(5,),
        keep=(0, 1, 2, 3, 4),
    )
    return SweepRuns.read(folder), pd.DataFrame(rows)


def test_factors_are_what_varies_in_order(swept):
    runs, _ = swept
    assert {factor.key: factor.values for factor in runs.factors} == {
        "detector": DETECTORS[:2],
        "max_components": (8, 12, 20),
        "fit.initializer": ("merged", "random"),
        "pose_error": (0.0, 0.1),
        "case": ("door", "still"),
    }
    assert [factor.numeric for factor in runs.factors] == [False, True, False, True, False]


def test_a_run_without_a_factor_has_no_place_in_it(swept):
    runs, frame = swept
    conditions = {row["key"]: json.loads(row["condition"]) for row in frame.to_dict("records")}
    error = runs.factor("pose_error")
    for key, code in zip(runs.texts("key"), error.codes, strict=True):
        assert (error.values[code] if code >= 0 else None) == conditions[key].get("pose_error")


def test_seeds_are_no_factor_and_data_that_a_case_tells_neither(tmp_path):
    make_sweep(tmp_path, conditions=({"seed": 1}, {"seed": 2}), k_max=(8,))
    assert [factor.key for factor in SweepRuns.read(tmp_path).factors] == ["detector"]


def test_a_study_per_factor_beside_the_detectors(swept):
    runs, _ = swept
    cut = studies(runs)
    assert series_factor(runs).key == "detector"
    assert [study.key for study in cut] == ["max_components", "fit.initializer", "pose_error", "case"]
    assert [factor.key for factor in cut[0].pooled] == ["fit.initializer", "pose_error", "case"]
    # of the runs with a pose error, all are of one case
    assert [factor.key for factor in cut[2].pooled] == ["max_components", "fit.initializer"]


def test_means_and_intervals_are_over_the_pairs(swept):
    runs, frame = swept
    study = studies(runs)[0]
    for series, detector in enumerate(study.series_names):
        for place, most in enumerate(study.axis.values):
            chosen = frame[(frame.detector == detector) & (frame.max_components == most)]
            scored = chosen.dropna(subset="kappa")
            group = study.at(series, place)
            means = scored.groupby("pair", sort=False).kappa.mean()
            interval = group.spreads["kappa"].interval
            assert (len(group.rows), group.num_failed) == (len(chosen), chosen.kappa.isna().sum())
            assert interval.mean == pytest.approx(means.mean())
            assert interval.count == len(means)
            assert interval.half_width == pytest.approx(bootstrap_interval(means).half_width, rel=0.2)
            np.testing.assert_allclose(
                group.spreads["kappa"].quartiles, scored.kappa.quantile([0.25, 0.5, 0.75]), rtol=1e-12
            )


def test_grouping_by_nothing_takes_all_runs(swept):
    runs, frame = swept
    (group,) = summarise(runs, [])
    assert len(group.rows) == len(frame)
    assert group.num_failed == (frame.status == "failed").sum()


def test_orders_and_paths(swept):
    runs, frame = swept
    found = orders(runs, studies(runs)[0])
    assert found.max_components == 20
    for detector in DETECTORS[:2]:
        chosen = frame[(frame.detector == detector) & (frame.max_components == 20)].dropna(subset="kappa")
        both = np.r_[chosen.reference_components, chosen.current_components]
        orders_found = range(1, int(both.max()) + 1)
        np.testing.assert_allclose(found.shares[detector], [(both == k).mean() for k in orders_found])
        paths = np.array([*chosen.reference_mdl_path, *chosen.current_mdl_path])
        rises = paths - paths.min(axis=1, keepdims=True)
        np.testing.assert_allclose(found.paths[detector].middle, np.median(rises, axis=0))
        of_detector = frame[frame.detector == detector].dropna(subset="kappa")
        medians = [
            np.median(np.r_[group.reference_components, group.current_components])
            for _, group in of_detector.groupby("max_components")
        ]
        np.testing.assert_array_equal(found.chosen[detector].x, [8, 12, 20])
        np.testing.assert_allclose(found.chosen[detector].middle, medians)


def test_a_fit_without_order_search_has_no_path(tmp_path):
    rows = make_sweep(tmp_path, k_max=(8,), detectors=DETECTORS[:2])
    for row in rows:
        row["attempt"] = 2
        if row["detector"] == DETECTORS[0]:
            row |= {f"{role}_mdl_path": [None] * 5 + [4e4] for role in ("reference", "current")}
    RowStore(SweepFolder(tmp_path)).write(rows)
    runs = SweepRuns.read(tmp_path)
    assert list(orders(runs, studies(runs)[0]).paths) == [DETECTORS[1]]


def test_costs_per_stage_and_on_the_clock(swept):
    runs, frame = swept
    spent = costs(runs, studies(runs)[0])
    answered = frame.dropna(subset="kappa")
    for stage in STAGES:
        assert spent.seconds["all"][stage] == pytest.approx(answered[f"seconds_{stage}"].mean())
    of_detector = answered[answered.detector == DETECTORS[0]]
    assert spent.seconds[DETECTORS[0]]["fit"] == pytest.approx(of_detector.seconds_fit.mean())
    assert spent.total == pytest.approx(answered.seconds.sum())
    assert spent.clock == pytest.approx((frame.finished.max() - frame.started.min()).total_seconds())
    assert (spent.workers, spent.peak_memory) == (1, 1.1e9)


def test_the_clock_stops_between_two_starts(tmp_path):
    rows = make_sweep(tmp_path, pairs=1, k_max=(8,), detectors=DETECTORS[:1])
    later = [row | {"key": f"later{k}", "pair": "later"} for k, row in enumerate(rows)]
    for row in later:
        row["started"], row["finished"] = (row[key] + pd.Timedelta(days=2) for key in ("started", "finished"))
    RowStore(SweepFolder(tmp_path)).write(later)
    runs = SweepRuns.read(tmp_path)
    assert costs(runs, studies(runs)[0]).clock == pytest.approx(80)


def test_failures_and_notes_that_differ_in_numbers_only_are_one_reason(swept):
    runs, frame = swept
    (reason,) = failures(runs)
    assert (reason.status, reason.num_runs) == ("failed", (frame.status == "failed").sum())
    assert reason.message.startswith("pairs.csv, line 7: scan_7.pcd: the file is cut short")
    assert reason.num_pairs == 3
    (note,) = remarks(runs)
    assert note.num_runs == (frame.status == "noted").sum()


def test_the_ends_of_the_scale_are_different_pairs(swept):
    runs, frame = swept
    ends = extremes(runs)
    assert [extreme.end for extreme in ends] == ["worst"] * 4 + ["best"] * 4
    kappas = runs.numbers("kappa")
    for end, extreme_of in (("worst", "min"), ("best", "max")):
        rows = [extreme.row for extreme in ends if extreme.end == end]
        of_pairs = frame.groupby("pair").kappa.agg(extreme_of).sort_values(ascending=end == "worst")
        assert list(runs.texts("pair")[rows]) == list(of_pairs.index[:4])
        np.testing.assert_allclose(kappas[rows], of_pairs.iloc[:4])
    assert all(extreme.kept is not None for extreme in ends)


def test_what_was_kept_is_given_back_in_metres(swept):
    runs, _ = swept
    kept = extremes(runs)[0].kept
    assert kept.changes["added"].point_labels.sum() == kept.scans["added"].labels.sum()
    assert len(kept.changes["removed"].components) == 9
    assert (
        sum(record.num_points for record in kept.changes["removed"].components)
        == kept.scans["removed"].num_points
    )


def test_few_pairs_are_not_at_both_ends(tmp_path):
    make_sweep(tmp_path, pairs=3)
    runs = SweepRuns.read(tmp_path)
    names = [runs.texts("pair")[extreme.row] for extreme in extremes(runs)]
    assert [extreme.end for extreme in extremes(runs)] == ["worst", "worst", "best", "best"]
    assert len(set(names)) >= 3


@pytest.mark.parametrize("kept", ["labels", "mixtures"])
def test_either_labels_or_mixtures_may_have_been_kept(tmp_path, kept):
    make_sweep(tmp_path, pairs=2, k_max=(8,), keep=(0, 1))
    of_labels = ("_states", "_scores", "_components")
    for file in (tmp_path / "results").glob("*.npz"):
        arrays = {k: v for k, v in np.load(file).items() if k.endswith(of_labels) == (kept == "labels")}
        np.savez(file, **arrays)
    change = extremes(SweepRuns.read(tmp_path))[0].kept.changes["added"]
    assert bool(change.components) == (kept == "mixtures")
    assert change.point_labels.any() == (kept == "labels")


def test_a_damaged_file_of_what_was_kept_is_as_if_it_were_not_there(tmp_path):
    make_sweep(tmp_path, pairs=2, k_max=(8,), keep=(0, 1))
    for file in (tmp_path / "results").glob("*.npz"):
        file.write_bytes(file.read_bytes()[:100])
    assert {extreme.kept for extreme in extremes(SweepRuns.read(tmp_path))} == {None}


# --- two sweeps


def test_paired_differences_are_those_of_the_same_runs(tmp_path):
    first = pd.DataFrame(make_sweep(tmp_path / "a", seed=1))
    second = pd.DataFrame(make_sweep(tmp_path / "b", seed=2, skill=0.05, pairs=5, repetitions=3))
    runs, other = SweepRuns.read(tmp_path / "a"), SweepRuns.read(tmp_path / "b")
    found = compare(runs, other, series_factor(runs))
    keys = ["pair", "repetition", "detector", "max_components"]
    both = first.merge(second, on=keys)
    assert found.matched_by == ("pair", "repetition", "detector", "max_components")
    assert (found.only_first, found.only_second) == (len(first) - len(both), len(second) - len(both))
    everything = found.lines[0]
    change = both.kappa_y - both.kappa_x
    assert everything.num_runs == len(both)
    assert everything.differences["kappa"].difference.mean == pytest.approx(
        change.groupby(both.pair).mean().mean()
    )
    assert everything.differences["kappa"].better == pytest.approx((change > 0).mean())
    line = found.lines[1]
    of_detector = both[both.detector == line.name]
    assert line.differences["kappa"].first == pytest.approx(of_detector.kappa_x.mean())
    assert line.differences["kappa"].second == pytest.approx(of_detector.kappa_y.mean())


def test_a_sweep_does_not_differ_from_itself(swept):
    runs, _ = swept
    found = compare(runs, runs, None)
    interval = found.lines[0].differences["kappa"].difference
    assert (interval.mean, interval.low, interval.high) == (0, 0, 0)
    assert found.lines[0].differences["kappa"].better == 0.5
    assert (found.only_first, found.only_second, found.differing) == (0, 0, ())


def test_what_is_the_same_within_a_sweep_and_not_in_the_other_is_named(tmp_path):
    make_sweep(tmp_path / "a", detectors=("likelihood",), k_max=(8, 12))
    make_sweep(tmp_path / "b", detectors=("greedy_emd",), k_max=(8, 12))
    found = compare(SweepRuns.read(tmp_path / "a"), SweepRuns.read(tmp_path / "b"), None)
    assert found.differing == ('detector: "likelihood" → "greedy_emd"',)
    assert found.matched_by == ("pair", "repetition", "max_components")


def test_a_factor_that_varies_in_one_sweep_only_is_matched_with_the_value_of_the_other(tmp_path):
    make_sweep(tmp_path / "a", k_max=(8, 12))
    make_sweep(tmp_path / "b", k_max=(12,))
    found = compare(SweepRuns.read(tmp_path / "a"), SweepRuns.read(tmp_path / "b"), None)
    assert found.only_second == 0
    assert found.only_first == found.lines[0].num_runs


def test_sweeps_over_other_pairs_are_refused(tmp_path):
    make_sweep(tmp_path / "a", conditions=({"pose_error": 0.5},))
    make_sweep(tmp_path / "b")
    with pytest.raises(InputError, match=r"have no run in common\. Runs are matched by pair, repetition"):
        compare(SweepRuns.read(tmp_path / "a"), SweepRuns.read(tmp_path / "b"), None)


def test_a_folder_without_rows_is_refused(tmp_path):
    with pytest.raises(InputError, match="there are no rows"):
        SweepRuns.read(tmp_path)
