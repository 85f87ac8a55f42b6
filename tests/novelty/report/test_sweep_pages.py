"""The files of a sweep's report: one page that needs nothing else, and tables and figures for a paper."""

import csv
import html
import json
import re
import sys

import numpy as np
import pandas as pd
import pytest

from novelty import InputError, MissingDependencyError
from novelty.cli import main
from novelty.report.sweep import (
    SweepRuns,
    write_sweep_csv,
    write_sweep_latex,
    write_sweep_page,
    write_sweep_plots,
)
from novelty.report.sweep.extremes import extremes
from novelty.report.sweep.orders import NO_SEARCH, Orders
from novelty.report.sweep.views import pair_views
from novelty.sweep import SweepFolder
from novelty.sweep.store import RowStore
from tests.novelty.report.sweep_case import DETECTORS, make_sweep


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two sweeps over the same pairs."""
    first, second = tmp_path_factory.mktemp("first"), tmp_path_factory.mktemp("second")
    make_sweep(first, failing=(5,), keep=(0, 1, 2, 3, 4))
    make_sweep(second, skill=0.05, seed=1)
    return first, second


@pytest.fixture(scope="module")
def runs(folders):
    return SweepRuns.read(folders[0])


def page_of(runs, path, **options):
    write_sweep_page(path, runs, **options)
    return path.read_text()


@pytest.fixture(scope="module")
def page(runs, tmp_path_factory):
    """The page of the first sweep."""
    return page_of(runs, tmp_path_factory.mktemp("page") / "report.html")


def content_of(page):
    return json.loads(
        re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.DOTALL)[1]
    )


# --- the page


def test_the_page_needs_nothing_else(page):
    without_plotly = re.sub(r"<script>.{1000000,}?</script>", "", page, flags=re.DOTALL)
    assert not re.findall(r'(?:src|href)="(?!#)', without_plotly)
    assert "@import" not in without_plotly
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page


def test_the_page_says_what_was_found(page):
    assert "Highest mean κ with detector joint_mixture" in page
    for words in ("Scores", "Model orders", "Worst and best pairs", "Failures", "To do it again"):
        assert f">{words}</h2>" in page
    assert "the file is cut short" in page
    assert "max_components: [8, 12, 20]" in page
    assert "2.13.0" in page


@pytest.mark.parametrize(("method", "told"), [("surface", True), ("none", False)])
def test_refinement_that_all_detectors_share_is_said(tmp_path, method, told):
    make_sweep(tmp_path / "rows", pairs=2, k_max=(8,), axes={"refine": [{"method": method}]})
    page = page_of(SweepRuns.read(tmp_path / "rows"), tmp_path / "report.html")
    assert ("run with refine.method=none" in page) == told


def test_the_table_of_scores_holds_means_with_intervals(runs, page):
    table = re.search(r'data-metric-table="kappa"[^>]*>(.*?)</table>', page, re.DOTALL)[1]
    names = re.findall(r'<th class="series">(.*?)</th>', table)
    shown = np.array(re.findall(r"<b>(.*?)</b>", table), dtype=float).reshape(-1, len(names))
    frame = runs.table.select(["detector", "max_components", "kappa"]).to_pandas()
    means = frame.groupby(["max_components", "detector"]).kappa.mean().unstack()
    assert names == list(means.columns)
    np.testing.assert_allclose(shown, means.to_numpy(), atol=6e-4)
    for mean, low, high in re.findall(r"<b>(.*?)</b><span>(.*?) to (.*?)</span>", table):
        assert float(low) < float(mean) < float(high)


def test_every_score_has_a_figure_with_both_bands(page):
    effects = content_of(page)["effects"]
    assert list(effects) == ["max_components"]
    assert list(effects["max_components"]) == ["kappa", "cramers_v", "uncertainty", "f1", "iou"]
    traces = effects["max_components"]["kappa"]["data"]
    lines = [trace for trace in traces if trace["mode"] == "lines+markers"]
    assert [trace["name"] for trace in lines] == list(DETECTORS)
    assert all(trace["x"] == [8, 12, 20] for trace in lines)
    bands = [trace["meta"]["band"] for trace in traces if "meta" in trace]
    assert sorted(set(bands)) == ["interval", "quartiles"]
    assert len(bands) == 2 * len(DETECTORS)


def test_pairs_that_were_kept_can_be_viewed_with_their_ellipsoids(page):
    views = re.findall(r'<script type="application/json" id="run-\d+">(.*?)</script>', page, re.DOTALL)
    assert len(views) == len(re.findall(r'data-run="', page)) == 6
    traces = json.loads(views[0])["added"]["data"]
    assert sum(trace["type"] == "mesh3d" for trace in traces) == 9
    assert any(trace["type"] == "scatter3d" for trace in traces)


def test_points_that_were_called_wrongly_are_drawn_apart(tmp_path):
    make_sweep(tmp_path, pairs=2, k_max=(8,), keep=(0, 1))
    missed, alarms = 11, 7
    for file in (tmp_path / "results").glob("*.npz"):
        arrays = dict(np.load(file))
        states = arrays["added_states"]
        novel, unchanged = np.flatnonzero(states == 1), np.flatnonzero(states == 0)
        states[novel[:missed]], states[unchanged[:alarms]] = 0, 1
        np.savez(file, **arrays)
    views = pair_views(extremes(SweepRuns.read(tmp_path)))
    names = [trace["name"] for trace in next(iter(views.values()))["added"]["data"]]
    assert f"missed ({missed} points)" in names
    assert f"false alarm ({alarms} points)" in names
    names = [trace["name"] for trace in next(iter(views.values()))["removed"]["data"]]
    assert not any(name.startswith(("missed", "false alarm")) for name in names)


def test_the_metrics_that_the_sweep_names_come_first(tmp_path):
    make_sweep(tmp_path)
    (tmp_path / "sweep.yaml").write_text("metrics: [iou, kappa, mcc]")
    effects = content_of(page_of(SweepRuns.read(tmp_path), tmp_path / "report.html"))["effects"]
    assert list(effects["max_components"]) == ["iou", "kappa", "cramers_v", "uncertainty", "f1"]


def test_the_rows_alone_are_enough(tmp_path):
    make_sweep(tmp_path)
    (tmp_path / "sweep.yaml").write_text("title: [")
    (tmp_path / "starts").mkdir()
    (tmp_path / "starts" / "1.json").write_text('{"command": "novelty sweep a.yaml --out b"}')
    (tmp_path / "starts" / "2.json").write_text('{"command": "novelty sw')
    page = page_of(SweepRuns.read(tmp_path), tmp_path / "report.html")
    assert "<pre>novelty sweep a.yaml --out b</pre>" in page
    (tmp_path / "sweep.yaml").unlink()
    page = page_of(SweepRuns.read(tmp_path), tmp_path / "report.html")
    assert f"<h1>{tmp_path.name}</h1>" in page
    assert "max_components: 8" in page  # the configuration of a run


def test_without_what_was_kept_the_page_says_how_to_keep_it(folders, tmp_path):
    page = page_of(SweepRuns.read(folders[1]), tmp_path / "report.html")
    assert 'data-run="' not in page
    assert "<code>keep</code>" in page


def test_names_from_data_cannot_break_the_page(tmp_path):
    make_sweep(tmp_path, pairs=2, k_max=(8,), conditions=({"<script>alert(1)</script>": "</script><b>"},))
    page = page_of(SweepRuns.read(tmp_path), tmp_path / "report.html")
    assert "</script><b>" not in page
    assert "<script>alert" not in page


def test_without_ground_truth_there_are_no_scores_and_the_rest_is_there(tmp_path):
    make_sweep(tmp_path, labelled=False)
    runs = SweepRuns.read(tmp_path)
    page = page_of(runs, tmp_path / "report.html")
    assert "There was no ground truth" in page
    assert ">Scores</h2>" not in page
    assert ">Model orders</h2>" in page
    write_sweep_plots(tmp_path / "figure.png", runs)
    with pytest.raises(InputError, match="no run has scores"):
        write_sweep_latex(tmp_path / "table.tex", runs)


@pytest.mark.parametrize("searched", [True, False])
def test_without_a_path_of_mdl_a_sentence_takes_the_place_of_its_figure(tmp_path, searched):
    rows = make_sweep(tmp_path, k_max=(8,), detectors=DETECTORS[:1])
    if not searched:
        one = {f"{role}_mdl_path": [None] * 5 + [4e4] for role in ("reference", "current")}
        RowStore(SweepFolder(tmp_path)).write([row | one | {"attempt": 2} for row in rows])
    page = page_of(SweepRuns.read(tmp_path), tmp_path / "report.html")
    assert ('id="plot-paths"' in page) == ("paths" in content_of(page)["plots"]) == searched
    assert (html.escape(NO_SEARCH) in page) != searched


def test_a_plot_without_a_path_of_mdl_says_so():
    from matplotlib.figure import Figure

    from novelty.report.sweep.plots import _draw_paths

    axes = Figure().subplots()
    _draw_paths(axes, Orders(8, {}, {}, {}), None)
    assert " ".join(axes.texts[0].get_text().split()) == NO_SEARCH
    assert not axes.axison


@pytest.mark.parametrize(
    "options",
    [
        {"detectors": DETECTORS[:1], "k_max": (8,), "pairs": 1, "repetitions": 1},
        {"detectors": DETECTORS[:1], "k_max": (8,), "axes": {"fit.moments": ["centroid", "spread"]}},
        {"k_max": (8,), "failing": range(6)},
        {"k_max": (8,), "axes": {"preprocess.outliers": [True, False, None]}},
    ],
)
def test_any_grid_can_be_reported(tmp_path, options):
    make_sweep(tmp_path, **options)
    runs = SweepRuns.read(tmp_path)
    assert "</html>" in page_of(runs, tmp_path / "report.html")
    write_sweep_csv(tmp_path / "table.csv", runs)
    write_sweep_plots(tmp_path / "figure.pdf", runs)


def test_a_page_of_two_sweeps_has_paired_differences_and_dashed_lines(folders, tmp_path):
    first, second = map(SweepRuns.read, folders)
    page = page_of(first, tmp_path / "report.html", other=second)
    assert ">Comparison</h2>" in page
    assert str(folders[1]) in page
    traces = content_of(page)["effects"]["max_components"]["kappa"]["data"]
    assert sum(trace.get("line", {}).get("dash") == "dash" for trace in traces) == len(DETECTORS)


# --- tables and figures


def test_csv_has_a_line_per_combination_and_leaves_no_run_out(tmp_path):
    make_sweep(tmp_path, conditions=({}, {"pose_error": 0.1}, {"pose_error": 0.2}), failing=(5,))
    runs = SweepRuns.read(tmp_path)
    write_sweep_csv(tmp_path / "table.csv", runs)
    table = pd.read_csv(tmp_path / "table.csv")
    assert table.runs.sum() == len(runs)
    assert table.failed.sum() == runs.failed.sum()
    means = runs.table.to_pandas().groupby(["condition", "detector", "max_components"]).kappa.mean()
    for line in table.itertuples():
        condition = "{}" if np.isnan(line.pose_error) else json.dumps({"pose_error": line.pose_error})
        key = (condition, line.detector, line.max_components)
        assert line.kappa_mean == pytest.approx(means[key], rel=1e-5)
        assert line.kappa_low < line.kappa_mean < line.kappa_high


def test_csv_of_two_sweeps_has_the_differences(folders, tmp_path):
    write_sweep_csv(tmp_path / "table.csv", *map(SweepRuns.read, folders))
    with (tmp_path / "table.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert {line["quantity"] for line in lines} == {
        "kappa",
        "cramers_v",
        "uncertainty",
        "f1",
        "iou",
        "seconds",
    }
    for line in lines:
        assert float(line["difference"]) == pytest.approx(
            float(line["other_sweep"]) - float(line["this_sweep"]), abs=0.01
        )


def test_latex_is_booktabs_with_every_special_character_escaped(folders, tmp_path):
    write_sweep_latex(tmp_path / "table.tex", *map(SweepRuns.read, folders))
    text = (tmp_path / "table.tex").read_text()
    assert text.count(r"\toprule") == text.count(r"\bottomrule") == text.count(r"\end{table}") == 5 + 6
    assert r"structural\_matching" in text
    assert r"\textbf{" in text
    body = re.sub(r"\\_|K_\{\\max\}|F_1", "", text)
    assert "_" not in body
    for table in re.findall(r"\\begin\{tabular\}\{(\w+)\}(.*?)\\end\{tabular\}", text, re.DOTALL):
        form, lines = table
        assert {line.count(" & ") + 1 for line in lines.splitlines() if line.endswith(r"\\")} == {len(form)}


@pytest.mark.parametrize(("name", "start"), [("figure.png", b"\x89PNG"), ("figure.pdf", b"%PDF")])
def test_figures_are_written_in_the_format_of_their_ending(folders, tmp_path, name, start):
    write_sweep_plots(tmp_path / name, *map(SweepRuns.read, folders))
    assert (tmp_path / name).read_bytes().startswith(start)


def test_missing_matplotlib_is_named_with_its_command(runs, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'novelty-gmm\[figures\]'"):
        write_sweep_plots(tmp_path / "figure.png", runs)


# --- the command


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(["report", *map(str, arguments)])
    return stop.value.code, capsys.readouterr()


def test_the_command_writes_into_the_folder_of_the_sweep(folders, capsys):
    code, text = run(capsys, folders[0])
    assert code == 0
    assert (folders[0] / "report.html").is_file()
    assert str(folders[0] / "report.html") in text.out


@pytest.mark.parametrize("name", ["table.csv", "table.tex", "figure.pdf"])
def test_the_ending_of_the_file_tells_the_format(folders, tmp_path, capsys, name):
    code, _ = run(capsys, folders[0], "--compare", folders[1], "--out", tmp_path / name)
    assert code == 0
    assert (tmp_path / name).stat().st_size > 500


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "name the folder of a sweep"),
        (["nowhere"], "there are no rows"),
        (["nowhere", "--out", "report.docx"], "expected a file ending in .html, .csv, .tex, .png, .pdf"),
        (["nowhere", "--format", "pdf", "--out", "a.png"], "expected a file ending in .pdf"),
        (["nowhere", "--format", "csv", "--benchmarks", "b.json"], "benchmarks are shown in html only"),
    ],
)
def test_what_cannot_be_done_is_refused(capsys, monkeypatch, arguments, message):
    monkeypatch.setenv("COLUMNS", "200")
    code, text = run(capsys, *arguments)
    assert code == 2
    assert message in text.err
