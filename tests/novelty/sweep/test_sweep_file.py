"""Sweeps as files: what they name, and what is said of what they get wrong."""

import numpy as np
import pytest

from novelty.errors import ConfigError, InputError
from novelty.sweep.folder import SweepFolder
from novelty.sweep.inputs import HashedPair, InputHashes, run_key
from novelty.sweep.settings import settings_of
from novelty.sweep.sources import pairs_of
from novelty.sweep.sweep import Sweep, load_sweep, sweep_names

ROOMS = {"setup": {"scene": "room", "changes": ["box"]}, "count": 2}


def sweep(**keys):
    return Sweep.from_mapping({"data": {"rooms": ROOMS}} | keys)


def write_scan(path, seed=0):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, np.random.default_rng(seed).normal(size=(20, 3)))


def test_a_grid_is_every_combination_and_the_last_key_changes_fastest():
    found = settings_of(sweep(grid={"max_components": [8, 20], "fit.n_init": [1, 2]}, repetitions=2))
    chosen = [(s.config.max_components, s.config.fit.n_init, s.config.seed, s.repetition) for s in found]
    assert chosen == [(k, n, r, r) for k in (8, 20) for n in (1, 2) for r in (0, 1)]


def test_a_zip_goes_in_step():
    found = settings_of(sweep(zip={"max_components": [8, 20], "fit.n_init": [3, 1]}, grid={"seed": [5, 6]}))
    chosen = [(s.config.max_components, s.config.fit.n_init, s.config.seed) for s in found]
    assert chosen == [(8, 3, 5), (8, 3, 6), (20, 1, 5), (20, 1, 6)]


def test_assignments_change_the_file(small_file):
    changed = load_sweep(small_file, ["grid.fit.n_init=[1, 2]", "data.rooms.count=5", "repetitions=3"])
    assert changed.grid["fit.n_init"] == [1, 2]
    assert changed.grid["max_components"] == [4, 8]
    assert (changed.data["rooms"].count, changed.repetitions) == (5, 3)


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("repetitons=2", r"unknown key 'repetitons'.*'repetitions'"),
        ("data.rooms.sed=2", r"unknown key 'data.rooms.sed'.*'seed'"),
        ("grid.max_component=[8]", r"unknown configuration key 'max_component'.*'max_components'"),
        ("grid.fit.n_ini=[8]", r"unknown configuration key 'fit.n_ini'.*'fit.n_init'"),
        ("configuration.detector=likelyhood", r"unknown detector 'likelyhood'.*'likelihood'"),
        ("metrics=[kapa]", r"unknown metric 'kapa'.*'kappa'"),
        ("data.more.setup.scen=room", r"data.more.*'scen'"),
        ("data.rooms.experiment=x", r"give one of.*found pairs, experiment"),
        ("zip.seed=[]", "seed has no values"),
        ("repetitions", "expected key=value"),
    ],
)
def test_mistakes_are_named_with_the_nearest_valid_name(small_file, assignment, message):
    def used():
        changed = load_sweep(small_file, [assignment])
        return settings_of(changed), pairs_of(changed)

    with pytest.raises(ConfigError, match=f"(?s){message}"):
        used()


@pytest.mark.parametrize("name", ["nokmax", "k_max", "runs/kmax"])
def test_a_sweep_that_is_not_there_is_told_those_that_are(name):
    with pytest.raises(
        ConfigError, match=rf"no sweep '{name}'; choose one of {', '.join(sweep_names())}, or"
    ):
        load_sweep(name)


def test_lists_of_a_zip_have_one_length():
    with pytest.raises(ConfigError, match="max_components 2, seed 1"):
        sweep(zip={"max_components": [8, 20], "seed": [1]})


def test_simulated_pairs_carry_their_condition():
    data = {"rooms": ROOMS | {"vary": {"noise": [0.01, 0.02]}, "seed": 7}}
    pairs = pairs_of(Sweep.from_mapping({"data": data}))
    assert len({pair.name for pair in pairs}) == 4
    assert pairs[-1].condition == '{"case":"rooms","noise":0.02,"seed":8}'
    assert pairs[-1].load().current.num_points > 1000


def test_an_experiment_is_its_pairs():
    data = {"paper": {"experiment": "static_platform", "count": 2, "seed": 3}}
    pairs = pairs_of(Sweep.from_mapping({"data": data}))
    assert len(pairs) == 6
    assert {pair.source.seed for pair in pairs} == {3, 4}


def test_patterns_pair_files_by_what_stands_for_the_star(tmp_path):
    for place in ("a", "b", "c"):
        write_scan(tmp_path / place / "before.xyz")
    for place in ("b", "c", "d"):
        write_scan(tmp_path / place / "after.xyz")
    (tmp_path / "s.yaml").write_text("data: {all: {reference: '*/before.xyz', current: '*/after.xyz'}}")
    pairs = pairs_of(load_sweep(tmp_path / "s.yaml"))
    assert [pair.name for pair in pairs] == ["b", "c"]
    assert pairs[0].load().reference.num_points == 20


def test_a_pattern_that_matches_nothing_is_an_error(tmp_path):
    data = {"all": {"reference": f"{tmp_path}/*/a.ply", "current": f"{tmp_path}/*/b.ply"}}
    with pytest.raises(InputError, match="no two files match"):
        pairs_of(Sweep.from_mapping({"data": data}))


def test_environment_variables_are_filled_in_or_asked_for(tmp_path, monkeypatch):
    (tmp_path / "s.yaml").write_text("data: {all: {pairs: $SCANS/pairs.csv}}")
    monkeypatch.setenv("SCANS", "/scans")
    assert load_sweep(tmp_path / "s.yaml").data["all"].pairs == "/scans/pairs.csv"
    monkeypatch.delenv("SCANS")
    with pytest.raises(ConfigError, match="is not set"):
        load_sweep(tmp_path / "s.yaml")


def test_the_key_of_a_run_follows_configuration_content_and_repetition(tmp_path):
    write_scan(tmp_path / "a.xyz"), write_scan(tmp_path / "b.xyz", 1)
    (tmp_path / "pairs.csv").write_text("name,reference,current\none,a.xyz,b.xyz\ntwo,b.xyz,a.xyz\n")
    described = Sweep.from_mapping(
        {"data": {"all": {"pairs": str(tmp_path / "pairs.csv")}}, "grid": {"seed": [0, 1]}, "repetitions": 2}
    )
    hashes = InputHashes(SweepFolder(tmp_path))
    pairs, settings = pairs_of(described), settings_of(described)
    keys = {run_key(HashedPair(pair, hashes.of(pair)), setting) for pair in pairs for setting in settings}
    assert len(keys) == 8

    before = hashes.of(pairs[0])
    assert InputHashes(SweepFolder(tmp_path)).of(pairs[0]) == before
    write_scan(tmp_path / "a.xyz", seed=2)
    assert InputHashes(SweepFolder(tmp_path)).of(pairs[0]) != before


def test_every_default_is_written_out_and_read_back(small):
    assert Sweep.from_mapping(small.to_mapping()) == small


@pytest.mark.parametrize("name", sweep_names())
def test_the_ready_sweeps_are_valid(name, monkeypatch, data_dir):
    monkeypatch.setenv("NOVELTY_DATA", str(data_dir))
    described = load_sweep(name)
    assert len(settings_of(described)) * len(pairs_of(described)) >= 50
