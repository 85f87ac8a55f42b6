"""Timings of pytest-benchmark: peers are compared with the fastest of ours, in the same table."""

import json

import pytest

from novelty import InputError
from novelty.cli import main
from novelty.report.benchmarks import Benchmarks, benchmark_tables, write_benchmark_page


def entry(name, median, group=None, library=None):
    extra = {"library": library} if library else {}
    return {
        "name": name,
        "group": group,
        "extra_info": extra,
        "stats": {"median": median, "iqr": median / 10, "rounds": 5},
    }


@pytest.fixture
def file(tmp_path):
    entries = [
        entry("test_em[sklearn]", 0.8, "EM, 100 iterations", "scikit-learn"),
        entry("test_em[gmmtorch]", 0.05, "EM, 100 iterations", "gmmtorch"),
        entry("test_em[daal]", 0.025, "EM, 100 iterations", "oneDAL"),
        entry("test_detect", 0.4),
    ]
    machine = {"cpu": {"brand_raw": "A processor", "count": 2}, "python_version": "3.11.4"}
    path = tmp_path / "bench.json"
    path.write_text(
        json.dumps({"benchmarks": entries, "machine_info": machine, "datetime": "2026-03-01T10:00:00"})
    )
    return path


def test_peers_stand_beside_us_by_speed(file):
    (name, peers), (last, stages) = benchmark_tables(Benchmarks.read(file))
    assert (name, last) == ("EM, 100 iterations", "Stages")
    assert [row.cells[0] for row in peers.rows] == ["oneDAL", "gmmtorch", "scikit-learn"]
    assert [row.cells[-1] for row in peers.rows] == ["0.50 ×", "1.00 ×", "16.00 ×"]
    assert [row.cells[:2] for row in stages.rows] == [("detect", "400")]


def test_the_page_names_the_machine(file, tmp_path):
    write_benchmark_page(tmp_path / "bench.html", Benchmarks.read(file))
    page = (tmp_path / "bench.html").read_text()
    assert "processor A processor, cores 2, Python 3.11.4" in page
    assert "scikit-learn" in page


def test_the_command_needs_no_sweep(file, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["report", "--benchmarks", str(file), "--out", str(tmp_path / "bench.html")])
    assert stop.value.code == 0
    assert "EM, 100 iterations" in (tmp_path / "bench.html").read_text()


@pytest.mark.parametrize("text", ["{", "[]", '{"benchmarks": [{"name": "a"}]}'])
def test_a_file_of_something_else_is_refused(tmp_path, text):
    (tmp_path / "bench.json").write_text(text)
    with pytest.raises(InputError, match="expected the JSON of pytest-benchmark"):
        Benchmarks.read(tmp_path / "bench.json")
    with pytest.raises(InputError, match="cannot be read"):
        Benchmarks.read(tmp_path / "nowhere.json")
