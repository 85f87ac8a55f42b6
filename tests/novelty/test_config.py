"""The configuration: what it refuses, and the file that documents it."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import novelty
from gmmtorch import Status
from novelty import Config, ConfigError, Scan, ScanPair
from novelty.config import baseline_names, detector_names, read_yaml_mapping
from novelty.config_yaml import commented_yaml, preset_yaml
from novelty.detectors import StructuralMatching
from novelty.fitting import Fit, FitPlan, advice_of
from novelty.preprocess import Preprocess, prepare_pairs
from novelty.presets import PRESETS

DEFAULT_FILE = Path(__file__).resolve().parents[2] / "configs" / "default.yaml"


def test_the_default_file_is_the_defaults_key_by_key():
    assert DEFAULT_FILE.read_text(encoding="utf-8") == commented_yaml()
    assert Config.from_yaml(DEFAULT_FILE) == Config()


def test_every_key_of_the_default_file_stands_under_a_comment():
    lines = DEFAULT_FILE.read_text(encoding="utf-8").splitlines()
    for before, line in itertools.pairwise(lines):
        if line.strip() and not line.lstrip().startswith("#"):
            assert before.lstrip().startswith("#"), line


@pytest.mark.parametrize("name", [*detector_names(), *baseline_names()])
def test_every_detector_has_a_section_of_its_name(name):
    assert Config(detector=name).chosen_detector == getattr(Config(), name)


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"max_component": 20}, ["max_component", "max_components"]),
        ({"fit": {"n_inits": 2}}, ["fit.n_inits", "n_init"]),
        ({"detector": "likelyhood"}, ["likelyhood", "likelihood"]),
        ({"fit": {"n_init": 0}}, ["fit.n_init", "greater than or equal to 1"]),
        ({"unit": "parsec"}, ["unit", "parsec"]),
        ({"preprocess": {"max_cell_size": "many"}}, ["preprocess.max_cell_size", "many"]),
    ],
)
def test_a_wrong_key_or_value_is_named_with_the_nearest_valid_one(mapping, words):
    with pytest.raises(ConfigError) as caught:
        Config.from_mapping(mapping)
    for word in words:
        assert word in str(caught.value)


def test_replace_changes_nested_keys_and_nothing_else():
    changed = Config().replace(**{"fit.n_init": 3, "detector": "greedy_emd"})
    assert (changed.fit.n_init, changed.detector) == (3, "greedy_emd")
    assert changed.replace(**{"fit.n_init": 1, "detector": Config().detector}) == Config()


@pytest.mark.parametrize("key", ["fits.n_init", "fit.n_inits", "unit.x"])
def test_replace_refuses_unknown_keys(key):
    with pytest.raises(ConfigError, match="unknown configuration key"):
        Config().replace(**{key: 1})


@pytest.mark.parametrize(
    ("key", "advice"),
    [
        ("min_std", "did you mean 'fit.min_std'?"),
        ("preprocess.min_std", "did you mean 'fit.min_std'?"),
        ("fits.min_std", "did you mean 'fit.min_std'?"),
        ("method", "did you mean 'registration.method' or 'refine.method' or 'visibility.method'?"),
        ("fit.n_inti", "did you mean 'fit.n_init'?"),
        ("max_component", "did you mean 'max_components'?"),
        ("fit.zzz", "known: moments, "),
    ],
)
def test_an_unknown_key_is_told_the_key_as_it_must_be_written(key, advice):
    with pytest.raises(ConfigError, match=re.escape(f"unknown configuration key {key!r}; {advice}")):
        Config().replace(**{key: 1})


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("detector", "likelyhood", "unknown detector 'likelyhood'; did you mean 'likelihood'?"),
        ("fit.n_init", 0, "Input should be greater than or equal to 1 (got 0)"),
        ("unit", "parsec", "Input should be 'm', 'cm', 'mm', 'in' or 'ft' (got 'parsec')"),
    ],
)
def test_a_value_that_is_not_valid_is_said_once(key, value, message):
    with pytest.raises(ConfigError, match=re.escape(f"configuration key {key!r}: {message}") + "$"):
        Config().replace(**{key: value})


@pytest.mark.parametrize("text", ["- a\n- b\n", "a: [1", "just words"])
def test_a_file_that_is_no_mapping_is_refused(tmp_path, text):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"config\.yaml"):
        Config.from_yaml(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"absent\.yaml"):
        Config.from_yaml(tmp_path / "absent.yaml")


def test_the_mapping_survives_yaml():
    config = Config().replace(**{"max_components": 7, "preprocess.max_height": 1.5})
    assert Config.from_mapping(yaml.safe_load(yaml.safe_dump(config.to_mapping()))) == config


def test_the_file_of_every_preset_is_what_it_changes():
    folder = DEFAULT_FILE.parent / "presets"
    assert {path.stem for path in folder.glob("*.yaml")} == set(PRESETS)
    for name in PRESETS:
        assert (folder / f"{name}.yaml").read_text(encoding="utf-8") == preset_yaml(name)
        assert Config().updated(read_yaml_mapping(folder / f"{name}.yaml")) == Config.preset(name)


def test_an_unknown_preset_is_named_with_the_nearest_one():
    with pytest.raises(ConfigError, match=r"papers.*did you mean 'paper'"):
        Config.preset("papers")


def test_a_file_changes_a_preset_key_by_key():
    changed = Config.preset("paper").updated({"fit": {"n_init": 2}, "detector": "structural_matching"})
    assert changed == Config.preset("paper").replace(**{"fit.n_init": 2, "detector": "structural_matching"})
    with pytest.raises(ConfigError, match=r"fit\.n_inits"):
        Config().updated({"fit": {"n_inits": 2}})


def test_the_preset_of_the_paper_is_what_it_prints():
    config = Config.preset("paper")
    assert (config.structural_matching.node_threshold, config.structural_matching.arc_threshold) == (3.5, 1.0)
    assert (config.preprocess.max_surface_variation, config.max_components) == (0.1, 20)
    assert config.fit.initializer == "evenly_spaced"
    assert config.greedy_emd.ground_distance == "mean"
    assert config.registration.method == config.refine.method == config.visibility.method == "none"


def test_the_calibrated_preset_differs_in_thresholds_only():
    config = Config.preset("paper_calibrated")
    thresholds = ("structural_matching.node_threshold", 3.5), ("structural_matching.arc_threshold", 1.0)
    assert config.detector == "structural_matching"
    assert config.replace(**dict(thresholds)) == Config.preset("paper").replace(
        detector="structural_matching"
    )
    assert (config.structural_matching.node_threshold, config.structural_matching.arc_threshold) == (
        3.25,
        12.1,
    )


def test_the_preset_reaches_the_fit(rng):
    points = rng.normal(size=(400, 3)) * (1.0, 1.0, 1e-6)
    batch = prepare_pairs([ScanPair(Scan(points), Scan(points))], Preprocess(outliers="none", ground="none"))
    thin = {}
    for floor in ("model", "paper"):
        plan = FitPlan(Fit(covariance_floor=floor, moments="centroid"), 2)
        fits = [StructuralMatching(fits=fits).fit(batch, plan).current for fits in ("independent", "coupled")]
        thin[floor] = [fit.mixtures.covariances[0, 0, 2, 2].item() for fit in fits]
    # Bouman's floor, 1e-5 of the mean variance, is far above the default, (1e-4 of the extent)^2.
    assert min(thin["paper"]) > 100 * max(thin["model"])


@pytest.mark.parametrize("status", [Status.FLOOR_REACHED, Status.NOT_CONVERGED])
def test_what_a_fit_advises_is_a_key_of_the_configuration(status):
    advice = advice_of(status)
    for key in re.findall(r"raise ([\w.]+)", advice):
        assert Config().replace(**{key: 1.0}) != Config()
    assert ("fit.min_std" in advice) == (status is Status.FLOOR_REACHED)


def test_the_notes_of_a_result_name_keys_of_the_configuration(rng):
    plane = Scan(np.concatenate([rng.uniform(0, 2, (400, 2)), np.zeros((400, 1))], axis=1))
    result = novelty.detect(ScanPair(plane, plane), Config().replace(**{"preprocess.ground": "none"}))
    assert "raise fit.min_std to" in result.message
