"""The commands on small scans, from the arguments to the exit code."""

import csv
import json

import numpy as np
import pytest

import novelty
from novelty.cli import main
from novelty.io import write_ply
from novelty.report import headline
from tests.novelty.report_case import make_pair

QUICK = ("--max-components", "8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    pair = make_pair(num_points=2000)
    write_ply(folder / "before.ply", pair.reference.points, label=pair.reference.labels)
    write_ply(folder / "after.ply", pair.current.points, label=pair.current.labels)
    write_ply(folder / "unlabelled.ply", pair.current.points)
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


class TestDetect:
    def test_begins_with_the_answer_and_fits_eighty_columns(self, run):
        code, out, err = run("detect", "before.ply", "after.ply", "--fail-on-change", *QUICK)
        assert (code, err) == (3, "")
        assert out.startswith("Changed: ")
        assert "extent [m]" in out
        assert max(len(line.rstrip()) for line in out.splitlines()) <= 80

    def test_a_scan_against_itself_has_not_changed(self, run):
        code, out, _ = run("detect", "before.ply", "before.ply", "--fail-on-change", *QUICK)
        assert code == 0
        assert out.startswith("No change found")

    def test_out_receives_the_record_the_scans_and_the_page(self, run, tmp_path):
        code, out, _ = run("detect", "before.ply", "after.ply", "--out", str(tmp_path / "new"), *QUICK)
        assert code == 0
        names = {path.name for path in (tmp_path / "new").iterdir()}
        assert names == {"result.json", "current.ply", "reference.ply", "report.html"}
        record = json.loads((tmp_path / "new" / "result.json").read_text())
        assert record["settings"]["max_components"] == 8
        assert out.startswith(record["answer"])
        assert set(record["scores"]) == {"added", "removed"}
        assert "report.html" in out

    def test_options_beat_assignments_beat_the_file(self, run, tmp_path):
        settings = tmp_path / "settings.yaml"
        settings.write_text("max_components: 3\nseed: 3\nfit: {n_init: 2}\n")
        run(
            *("detect", "before.ply", "after.ply", "--config", str(settings), "--out", str(tmp_path / "out")),
            *("--set", "seed=4", "--set", "max_components=5", "--max-components", "6"),
        )
        used = json.loads((tmp_path / "out" / "result.json").read_text())["settings"]
        assert (used["max_components"], used["seed"], used["fit"]["n_init"]) == (6, 4, 2)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (("before.ply", "aftr.ply"), "Did you mean 'after.ply'?"),
            (("before.ply", "after.ply", "--set", "fit.n_inti=3"), "did you mean 'fit.n_init'?"),
            (("before.ply", "after.ply", "--set", "seed"), "KEY=VALUE"),
            (("before.ply", "after.ply", "--detector", "likelyhood"), "did you mean 'likelihood'?"),
            (("before.ply", "after.ply", "--unit", "furlong"), "furlong"),
            (("before.ply", "after.ply", "--config", "no.yaml"), "no.yaml"),
            (("before.ply", "after.ply", "--reference-origin", "1 2"), "three numbers"),
            (("before.ply", "after.ply", "--out", "before.ply/in"), "cannot be made"),
            (("before.ply",), "CUR"),
        ],
    )
    def test_what_cannot_be_used_is_told_in_one_message(self, run, arguments, message):
        code, out, err = run("detect", *arguments)
        assert (code, out) == (2, "")
        assert message in err
        assert "Traceback" not in err

    def test_out_never_overwrites_a_scan(self, run, folder, tmp_path):
        raw = tmp_path / "pair"
        raw.mkdir()
        for name, copy in (("before.ply", "reference.ply"), ("after.ply", "current.ply")):
            (raw / copy).write_bytes((folder / name).read_bytes())
        before = {path.name: path.read_bytes() for path in raw.iterdir()}
        (tmp_path / "link").symlink_to(raw)
        for inputs in ((raw / "reference.ply", raw / "current.ply"), ("before.ply", "after.ply")):
            for out_folder in (raw, tmp_path / "link"):
                code, out, err = run("detect", *map(str, inputs), "--out", str(out_folder))
                assert (code, out) == (2, "")
                assert "overwrite" in err
                assert "choose another folder" in err
        assert {path.name: path.read_bytes() for path in raw.iterdir()} == before

    def test_an_identical_cloud_has_no_answer(self, run, folder):
        (folder / "same.xyz").write_text("1 2 3\n" * 40)
        code, _, err = run("detect", "same.xyz", "after.ply")
        assert code == 2
        assert "same.xyz" in err


class TestEvaluate:
    @pytest.fixture
    def manifest(self, folder):
        lines = [
            "name,reference,current,unit",
            "room,before.ply,after.ply,",
            "missing,before.ply,nope.ply,",
            "plain,unlabelled.ply,unlabelled.ply,",
            "odd,before.ply,after.ply,furlong",
        ]
        (folder / "pairs.csv").write_text("\n".join(lines) + "\n")
        return "pairs.csv"

    def test_failed_pairs_stay_in_their_place(self, run, manifest, tmp_path):
        rows_file = tmp_path / "rows.csv"
        code, out, err = run("evaluate", manifest, "--out", str(rows_file), *QUICK)
        assert code == 1
        assert "mean of 1" in out
        assert max(len(line.rstrip()) for line in out.splitlines() if "rows.csv" not in line) <= 80
        rows = list(csv.DictReader(rows_file.open()))
        assert [row["name"] for row in rows] == ["room", "missing", "plain", "odd"]
        assert float(rows[0]["kappa"]) == pytest.approx(
            (float(rows[0]["kappa_added"]) + float(rows[0]["kappa_removed"])) / 2
        )
        for row, reason in zip(rows[1:], ("nope.ply", "ground truth", "furlong"), strict=True):
            assert row["kappa"] == ""
            assert reason in row["failure"]
            assert f"{row['name']} failed: " in err

    def test_several_detectors_and_json(self, run, folder, tmp_path):
        (folder / "one.csv").write_text("name,reference,current\nroom,before.ply,after.ply\n")
        rows_file = tmp_path / "rows.json"
        chosen = ("--detector", "likelihood", "--detector", "structural_matching")
        code, _, err = run("evaluate", "one.csv", *chosen, "--out", str(rows_file), *QUICK)
        assert (code, err) == (0, "")
        rows = json.loads(rows_file.read_text())["rows"]
        assert [row["detector"] for row in rows] == ["likelihood", "structural_matching"]
        assert rows[0]["seen_once_called_novel"] is None

    def test_batches_do_not_change_the_rows(self, run, folder, tmp_path, monkeypatch):
        (folder / "two.csv").write_text(
            "name,reference,current\na,before.ply,after.ply\nb,after.ply,before.ply\n"
        )
        kappas = []
        for limit in (1, 10**9):
            monkeypatch.setattr("novelty.cli.evaluate.POINTS_PER_BATCH", limit)
            run("evaluate", "two.csv", "--out", str(tmp_path / "rows.json"), *QUICK)
            rows = json.loads((tmp_path / "rows.json").read_text())["rows"]
            kappas.append([row["kappa"] for row in rows])
        assert kappas[0] == pytest.approx(kappas[1], abs=1e-9)

    def test_the_time_of_a_batch_stands_once(self, run, folder):
        (folder / "two.csv").write_text(
            "name,reference,current\na,before.ply,before.ply\nb,before.ply,after.ply\n"
        )
        _, out, _ = run("evaluate", "two.csv", *QUICK)
        last = {
            first: more[-1]
            for line in out.splitlines()
            if line.strip()
            for first, *more in [line.split()]
            if more
        }
        assert last["a"] == last["b"] == "–"
        assert float(last["mean"]) > 0

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (("no.csv",), "no such manifest"),
            (("before.ply",), "with the columns name, reference, current; found a scan"),
            (("pairs.csv", "--out", "rows.txt"), ".csv or .json"),
            (("pairs.csv", "--out", "pairs.csv"), "overwrite"),
        ],
    )
    def test_what_cannot_be_used_is_refused(self, run, manifest, arguments, message):
        code, _, err = run("evaluate", *arguments)
        assert code == 2
        assert message in err
        assert "Traceback" not in err


def test_simulated_pairs_can_be_evaluated(run, tmp_path):
    code, out, _ = run(
        "simulate", "--out", str(tmp_path), "--count", "2", "--seed", "5", "--change", "person"
    )
    assert code == 0
    assert "2 pairs" in out
    rows = list(csv.DictReader((tmp_path / "pairs.csv").open()))
    assert [row["name"] for row in rows] == ["corridor-5", "corridor-6"]

    from novelty.io import load_pairs

    pairs = list(load_pairs(tmp_path / "pairs.csv"))
    assert all((pair.current.labels == 1).any() and pair.current.origin is not None for pair in pairs)


def test_an_unknown_scene_is_refused(run, tmp_path):
    code, _, err = run("simulate", "--out", str(tmp_path / "new"), "--scene", "coridor")
    assert code == 2
    assert "corridor" in err


@pytest.mark.slow
def test_demo_runs_every_detector(run, tmp_path):
    from novelty.config import detector_names

    code, out, _ = run("demo", "--out", str(tmp_path))
    assert code == 0
    for name in detector_names():
        assert name in out
        assert (tmp_path / name / "report.html").exists()


def test_help_names_the_detectors_there_are():
    from novelty.cli.options import DETECTORS
    from novelty.config import detector_names

    assert set(DETECTORS.replace(",", "").split()) - {"or"} == set(detector_names())


def test_a_pair_of_which_nothing_is_examined_is_not_called_unchanged(rng):
    floor = novelty.Scan(np.c_[rng.uniform(0, 3, (500, 2)), np.zeros(500)])
    result = novelty.detect(novelty.ScanPair(floor, floor))
    assert result.added.num_examined == 0
    assert headline(result) == "Nothing was compared: no point is left to examine"
