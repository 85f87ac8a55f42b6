"""The configuration: what it refuses, and the file that documents it."""

import itertools
from pathlib import Path

import pytest
import yaml

from novelty import Config, ConfigError
from novelty.config import baseline_names, detector_names
from novelty.config_yaml import commented_yaml

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
