"""Calibration: thresholds of least error, settings chosen on folds, and the command."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import yaml

from novelty import Config, ConfigError, InputError, Scan, ScanPair, detect, evaluate
from novelty.calibration import (
    Pairings,
    calibrate,
    fit_pair,
    kappa,
    least_error_thresholds,
    pairings,
    pairings_of,
)
from novelty.calibration.grids import GRIDS, settings_of
from novelty.cli.app import main
from novelty.cli.calibrate import _show as show_calibration
from novelty.config import baseline_names, detector_names
from novelty.config_yaml import changed_yaml
from novelty.io import write_ply
from novelty.simulation import room_pair
from tests.reference.pairings import p_err

FAST = Config().replace(max_components=12)


@pytest.fixture(scope="module")
def pairs():
    return [room_pair(seed, ("person", "box"), density=0.25, noise=0.01) for seed in range(3)]


@pytest.fixture(scope="module")
def fitted(pairs):
    return [fit_pair(pair, FAST) for pair in pairs]


@pytest.fixture(scope="module")
def structural(pairs):
    config = FAST.replace(detector="structural_matching")
    return config, [fit_pair(pair, config) for pair in pairs[:2]]


def test_every_grid_is_of_valid_settings_that_hold_the_default():
    for detector, grid in GRIDS.items():
        for settings in settings_of(detector):
            Config().replace(**settings)
        section = Config().to_mapping()[detector]
        assert all(section[key] in values for key, values in grid.items()), detector


def test_every_detector_can_be_calibrated():
    assert set(detector_names()) <= {*GRIDS, "structural_matching"}
    assert set(GRIDS) <= {*detector_names(), *baseline_names()}


def test_kappa_of_a_fitted_pair_is_that_of_detect(pairs, fitted):
    result = detect(pairs[0], FAST)
    sides = ((pairs[0].current, result.added), (pairs[0].reference, result.removed))
    values = [
        evaluate(scan.labels == 1, change.point_labels, ignore=scan.labels >= 2).kappa
        for scan, change in sides
    ]
    assert kappa(fitted[0], FAST) == pytest.approx(np.nanmean(values), abs=1e-12)


def test_thresholds_agree_with_counting(rng):
    valid = rng.gamma(2.0, (0.5, 0.2), (300, 2))
    invalid = rng.gamma(4.0, (1.5, 0.6), (500, 2))
    found = least_error_thresholds([Pairings(valid, invalid)])
    assert found.error == pytest.approx(p_err(valid, invalid, found.node, found.arc), abs=1e-12)
    others = [
        p_err(valid, invalid, u, r) for u in np.arange(0.25, 10.1, 0.25) for r in np.arange(0.1, 4.05, 0.1)
    ]
    assert found.error <= min(others) + 0.005


def test_separable_pairings_are_separated():
    valid, invalid = np.full((20, 2), (1.0, 0.3)), np.full((20, 2), (6.0, 3.0))
    found = least_error_thresholds([Pairings(valid, invalid)])
    assert found.error == 0
    assert found.node > 1
    assert found.arc > 0.3
    assert found.node < 6 or found.arc < 3


def test_thresholds_are_looked_for_as_far_as_differences_go(rng):
    # In metres and logarithms, differences of right pairings reach 8, twice what was once the largest value tried.
    valid = np.column_stack([rng.uniform(0, 3, 400), rng.uniform(2, 8, 400)])
    invalid = np.column_stack([rng.uniform(0, 3, 400), rng.uniform(9, 16, 400)])
    found = least_error_thresholds([Pairings(valid, invalid)])
    assert 7.9 < found.arc < 9.2
    assert (
        found.error
        == pytest.approx(p_err(valid, invalid, found.node, found.arc))
        == pytest.approx(0, abs=0.006)
    )
    assert found.grid.arc[-1] == pytest.approx(invalid[:, 1].max(), abs=0.1)
    assert not any(note.startswith("U_R") for note in found.notes)


def test_a_threshold_that_decides_nothing_is_told(rng):
    # Differences of right and of wrong pairings are alike: up to 5 U_R rejects right ones, from there on none.
    delta = np.linspace(0.05, 5.0, 400)
    valid = np.column_stack([np.full(400, 1.0), delta])
    invalid = np.column_stack([np.full(400, 6.0), delta])
    (note,) = least_error_thresholds([Pairings(valid, invalid)]).notes
    assert "U_R: every value from 5 on" in note


def test_the_largest_value_that_is_tried_is_told():
    valid = np.column_stack([np.full(200, 1.0), np.linspace(1.0, 400.0, 200)])
    invalid = np.column_stack([np.full(200, 6.0), np.linspace(1.0, 900.0, 200)])
    found = least_error_thresholds([Pairings(valid, invalid)])
    assert found.grid.arc[-1] == 40
    (note,) = found.notes
    assert "U_R: the largest value tried, 40, errs least" in note
    assert "length_scale" in note


def test_calibration_passes_on_what_is_to_be_said(structural, monkeypatch, capsys):
    config, fitted = structural
    least = least_error_thresholds([pairings_of(pair, config.structural_matching) for pair in fitted])
    for better, notes in ((least.arc, least.notes), (config.structural_matching.arc_threshold, ())):
        monkeypatch.setattr(
            "novelty.calibration.crossvalidation.kappa",
            lambda pair, config, better=better: float(config.structural_matching.arc_threshold == better),
        )
        found = calibrate(fitted, config)
        assert found.settings["structural_matching.arc_threshold"] == better
        assert found.notes == notes
    assert least.notes  # in units of the components, no difference is so large that a pairing is wrong
    show_calibration(replace(found, notes=("U_R: [any] value does.",)), config)
    assert "Note: U_R: [any] value does." in capsys.readouterr().out


def test_thresholds_need_pairings():
    none = np.empty((0, 2))
    with pytest.raises(InputError, match="hold the same unchanged place"):
        least_error_thresholds([Pairings(none, none)])


def test_valid_pairings_are_nearer_than_invalid_ones(structural):
    config, fitted = structural
    found = pairings_of(fitted[0], config.structural_matching)
    assert len(found.valid) > 20
    assert np.median(found.valid[:, 0]) < 0.2 * np.median(found.invalid[:, 0])
    assert np.median(found.valid[:, 1]) < np.median(found.invalid[:, 1])


@pytest.mark.parametrize("terms", ["squared", "plain"])
@pytest.mark.parametrize("scale", ["component", "metre"])
def test_differences_are_those_of_the_graphs(structural, scale, terms):
    config, fitted = structural
    detector = config.replace(
        **{
            "structural_matching.scale": scale,
            "structural_matching.arc_terms": terms,
            "structural_matching.node_threshold": 1e6,
            "structural_matching.arc_threshold": 0.5,
        }
    ).structural_matching
    sides = pairings._components(fitted[0], detector)
    graphs = detector._graphs(*sides)
    valid, _ = pairings._judged(fitted[0])
    delta = pairings_of(fitted[0], detector).valid[:, 1]
    # Every arc between two valid nodes, in both directions, is a valid pairing that has a valid one beside it.
    is_valid = torch.from_numpy(valid)[graphs.nodes_a[0], graphs.nodes_b[0]]
    assert (delta <= 0.5).sum() == graphs.adjacency[0][is_valid][:, is_valid].sum().item() > 0


def test_structural_matching_learns_its_thresholds(structural):
    config, fitted = structural
    found = calibrate(fitted, config)
    assert set(found.settings) == {"structural_matching.node_threshold", "structural_matching.arc_threshold"}
    assert np.isfinite(found.after).all()


@pytest.fixture
def small_grid(monkeypatch):
    monkeypatch.setitem(GRIDS, "likelihood", {"explained_share": (0.1, 1e-12)})


def test_a_bad_start_is_mended_on_pairs_held_out(pairs):
    # A baseline, since refinement would mend the labels of a detector too.
    bad = FAST.replace(**{"detector": "nearest_neighbour", "nearest_neighbour.distance": 5.0})
    found = calibrate([fit_pair(pair, bad) for pair in pairs], bad)
    assert found.gain.mean > 0.2
    assert found.settings["nearest_neighbour.distance"] < 5
    assert len(found.chosen) == 3


@pytest.mark.usefixtures("small_grid")
def test_the_given_settings_win_among_equals(fitted, monkeypatch):
    monkeypatch.setattr("novelty.calibration.crossvalidation.kappa", lambda pair, config: 0.5)
    config = FAST.replace(**{"likelihood.explained_share": 0.07})
    assert calibrate(fitted, config).settings == {"likelihood.explained_share": 0.07}


def test_one_pair_has_no_folds(fitted):
    with pytest.raises(InputError, match="needs two at least; found 1"):
        calibrate(fitted[:1], FAST)


@pytest.mark.parametrize("num_folds", [1, 4])
def test_folds_must_fit_the_pairs(fitted, num_folds):
    with pytest.raises(InputError, match="between 2 and the number of pairs, 3"):
        calibrate(fitted, FAST, num_folds)


def test_a_detector_without_a_grid_is_refused(fitted):
    with pytest.raises(ConfigError, match="'m3c2' has nothing to calibrate"):
        calibrate(fitted, FAST.replace(detector="m3c2"))


def test_pairs_without_truth_are_refused(pairs):
    bare = Scan(pairs[0].current.points)
    with pytest.raises(InputError, match="the current scan carries no ground truth"):
        fit_pair(ScanPair(pairs[0].reference, bare, "bare"), FAST)
    same = Scan(pairs[0].reference.points, labels=np.zeros(pairs[0].reference.num_points))
    with pytest.raises(InputError, match="labelled changed"):
        fit_pair(ScanPair(same, same, "same"), FAST)


def test_changed_yaml_holds_what_differs():
    config = Config().replace(**{"detector": "greedy_emd", "likelihood.quorum": 0.25, "fit.n_init": 3})
    text = changed_yaml(config, "# why\n")
    assert text.startswith("# why\n")
    assert yaml.safe_load(text) == {
        "detector": "greedy_emd",
        "fit": {"n_init": 3},
        "likelihood": {"quorum": 0.25},
    }


def write_manifest(folder, pairs):
    lines = ["name,reference,current"]
    for number, pair in enumerate(pairs):
        names = [f"{number}-{role}.ply" for role in ("reference", "current")]
        for name, scan in zip(names, (pair.reference, pair.current), strict=True):
            labels = {} if scan.labels is None else {"label": scan.labels}
            write_ply(folder / name, scan.points, **labels)
        lines.append(",".join([f"pair {number}", *names]))
    (folder / "pairs.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "pairs.csv"


def calibrated(folder, pairs, *settings):
    """Run the command with these assignments; the file it was to write."""
    target = folder / "found.yaml"
    assignments = [word for setting in settings for word in ("--set", setting)]
    with pytest.raises(SystemExit) as stopped:
        main(["calibrate", str(write_manifest(folder, pairs)), *assignments, "--out", str(target)])
    assert stopped.value.code == 0
    return target


def test_command_writes_a_configuration_that_can_be_read(tmp_path, pairs, capsys):
    bad = ("detector=nearest_neighbour", "nearest_neighbour.distance=5", "max_components=12")
    target = calibrated(tmp_path, pairs[:2], *bad)
    assert Config.from_yaml(target).nearest_neighbour.distance < 5
    assert Config.from_yaml(target).max_components == 12
    assert "as they were given" not in target.read_text()
    assert "Gain on held-out pairs: +" in capsys.readouterr().out


def test_command_keeps_the_given_settings_where_nothing_is_gained(tmp_path, pairs, capsys):
    target = calibrated(tmp_path, pairs[:2], "detector=structural_matching", "max_components=12")
    given = Config().replace(detector="structural_matching", max_components=12)
    assert Config.from_yaml(target) == given
    assert "Nothing gained: these are the settings as they were given." in target.read_text()
    told = " ".join(capsys.readouterr().out.split())
    assert "the settings stay as given" in told
    assert str(target) in told


def test_command_names_the_line_of_an_unlabelled_pair(tmp_path, pairs, capsys):
    bare = ScanPair(Scan(pairs[0].reference.points), Scan(pairs[0].current.points))
    manifest = write_manifest(tmp_path, [bare, pairs[0]])
    with pytest.raises(SystemExit) as stopped:
        main(["calibrate", str(manifest), "--out", str(tmp_path / "found.yaml")])
    assert stopped.value.code == 2
    message = " ".join(capsys.readouterr().err.split())
    assert "line 2" in message
    assert "carries no ground truth" in message
    assert not (tmp_path / "found.yaml").exists()
