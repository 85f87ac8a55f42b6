"""`novelty fit`, `novelty update`, and `novelty detect` with a map."""

import json
import shutil

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from novelty.cli import main
from novelty.io import read_scan, write_ply
from novelty.maps import SceneMap
from novelty.simulation import simulate_pair

QUICK = ("--max-components", "8")


@pytest.fixture(scope="module")
def origin():
    return "0.7 -0.12777758 1.2"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("place")
    pair = simulate_pair("room", 31, ("person", "remove"), density=0.3).scans
    write_ply(folder / "before.ply", pair.reference.points)
    write_ply(folder / "after.ply", pair.current.points)
    write_ply(folder / "millimetres.ply", pair.reference.points * 1000)
    save_file({"weight": np.zeros(3)}, folder / "weights.safetensors")
    return folder


@pytest.fixture
def run(capsys, folder, monkeypatch):
    """Call the command line in the folder of the scans; gives exit code, stdout and stderr."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "80")

    def call(*arguments):
        with pytest.raises(SystemExit) as stop:
            main(arguments)
        return stop.value.code, *capsys.readouterr()

    return call


@pytest.fixture(scope="module")
def fitted_map(folder, origin):
    file = folder / "room.safetensors"
    with pytest.raises(SystemExit) as stop:
        main(("fit", str(folder / "before.ply"), "--out", str(file), "--origin", origin, *QUICK))
    assert stop.value.code == 0
    return file


@pytest.fixture
def map_file(fitted_map, tmp_path):
    """A copy, since an update replaces the file."""
    return str(shutil.copy(fitted_map, tmp_path))


def fits(text):
    return max(len(line.rstrip()) for line in text.splitlines() if "safetensors" not in line) <= 80


@pytest.mark.parametrize("command", ["fit", "update"])
def test_help_fits_eighty_columns(run, command):
    code, out, _ = run(command, "--help")
    assert code == 0
    assert max(len(line) for line in out.splitlines()) <= 80


def test_fit_says_what_it_wrote(run, tmp_path):
    file = tmp_path / "room.safetensors"
    code, out, err = run("fit", "before.ply", "--out", str(file), *QUICK)
    assert (code, err) == (0, "")
    assert f"{file.stat().st_size / 1000:.0f} kB" in out
    assert f"{SceneMap.load(file).num_points:,}".replace(",", " ") in out
    assert "--origin" in out  # nothing said where the sensor stood
    assert fits(out)


def test_detect_takes_a_map(run, map_file, origin, tmp_path):
    arguments = ("after.ply", "--current-origin", origin, "--fail-on-change", "--out", str(tmp_path / "out"))
    code, out, err = run("detect", map_file, *arguments)
    assert (code, err) == (3, "")
    assert out.startswith("Changed: ")
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["settings"]["max_components"] == 8  # the map's
    cells = read_scan(tmp_path / "out" / "reference.ply").points
    assert np.allclose(cells, SceneMap.load(map_file).as_scan().points, atol=1e-4)
    assert (tmp_path / "out" / "report.html").stat().st_size > 0


def test_update_takes_the_change_into_the_map(run, map_file, origin, tmp_path):
    new = str(tmp_path / "new.safetensors")
    code, out, err = run("update", map_file, "after.ply", "--current-origin", origin, "--out", new)
    assert (code, err) == (0, "")
    assert "from 2 scans" in out
    assert "forgotten" in out
    assert fits(out)
    assert SceneMap.load(map_file).num_scans == 1
    _, out, _ = run("detect", new, "after.ply", "--current-origin", origin)
    assert out.startswith("No change found")


def test_update_replaces_the_map_and_says_what_it_cannot_know(run, map_file):
    code, out, _ = run("update", map_file, "after.ply")
    assert code == 0
    assert "Nothing was forgotten" in out
    assert SceneMap.load(map_file).num_scans == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("detect", "MAP", "after.ply", "--unit", "mm"), "set unit to m"),
        (("detect", "MAP", "after.ply", "--reference-origin", "0 0 0"), "a map, which knows"),
        (("detect", "MAP", "after.ply", "--set", "preprocess.outlier_neighbors=9"), "a map brings the"),
        (("detect", "none.safetensors", "after.ply"), "no such map"),
        (
            ("update", "before.ply", "after.ply"),
            "found a scan; `novelty fit before.ply --out MAP.safetensors`",
        ),
        (("detect", "after.ply", "MAP"), "a map comes first: `novelty detect MAP CUR`"),
        (("update", "MAP", "aftr.ply"), "Did you mean 'after.ply'?"),
        (("fit", "before.ply"), "--out"),
        (("fit", "bfore.ply", "--out", "x.safetensors"), "Did you mean 'before.ply'?"),
        (("fit", "before.ply", "--out", "before.ply/x.safetensors"), "cannot be written"),
        (("fit", "before.ply", "--out", "after.ply"), "ending in .safetensors"),
        (("fit", "before.ply", "--out", "map.npz"), "ending in .safetensors"),
        (("fit", "before.ply", "--out", "weights.safetensors"), "is no map"),
        (("update", "MAP", "after.ply", "--out", "after.ply"), "ending in .safetensors"),
        (("update", "MAP", "after.ply", "--out", "weights.safetensors"), "is no map"),
    ],
)
def test_what_cannot_be_used_is_told_in_one_message(run, folder, map_file, arguments, message):
    code, out, err = run(*(map_file if part == "MAP" else part for part in arguments))
    assert (code, out) == (2, "")
    assert message in err
    assert "Traceback" not in err
    assert len(load_file(folder / "weights.safetensors")) == 1


def test_a_map_of_millimetres_is_compared_in_millimetres(run, tmp_path):
    file = tmp_path / "mm.safetensors"
    run("fit", "millimetres.ply", "--out", str(file), "--unit", "mm", *QUICK)
    renamed = file.rename(tmp_path / "mm.map")  # known by its contents
    code, out, _ = run("detect", str(renamed), "millimetres.ply", "--fail-on-change")
    assert code == 0
    assert out.startswith("No change found")
