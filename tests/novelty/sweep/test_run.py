"""Running sweeps: the rows are those of single runs, nothing is run twice, and one bad run harms no other."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow as pa
import pytest

import novelty
from novelty.sweep import compute as stages
from novelty.sweep import read_rows
from novelty.sweep.compute import Prepared, compute
from novelty.sweep.folder import SweepFolder
from novelty.sweep.rows import EXACT, FAILED, NOTED, OK, OUT_OF_MEMORY
from novelty.sweep.run import RunOptions, make_plan, run_sweep
from novelty.sweep.settings import settings_of
from novelty.sweep.sources import pairs_of
from novelty.sweep.store import RUN, StoreError
from novelty.sweep.sweep import Sweep

HERE = RunOptions(workers=0)


@pytest.fixture(scope="module")
def finished(small, tmp_path_factory):
    """The folder of the small sweep after one run, to be read only, and the summary of that run."""
    folder = tmp_path_factory.mktemp("finished")
    return folder, run_sweep(small, folder, HERE)


@pytest.fixture
def finished_copy(finished, tmp_path):
    return shutil.copytree(finished[0], tmp_path / "copy")


def outcome(root, columns=EXACT):
    """The rows of a folder, in an order of their own, without what they cost."""
    return (
        read_rows(root)
        .sort_by([(name, "ascending") for name in RUN])
        .select([c for c in columns if c != "key"])
    )


def same(one: pa.Table, other: pa.Table) -> bool:
    """Equal to the last digit but for numbers, which may differ by rounding."""
    left, right = one.to_pandas(), other.to_pandas()
    numbers = left.select_dtypes("float").columns
    exact = left.columns.difference([*numbers, "reference_mdl_path", "current_mdl_path"])
    return left[exact].equals(right[exact]) and np.allclose(
        left[numbers], right[numbers], rtol=1e-6, equal_nan=True
    )


def listed(folder, pairs):
    """A manifest of pairs of point arrays."""
    lines = ["name,reference,current"]
    for name, scans in pairs.items():
        for role, points in zip(("a", "b"), scans, strict=True):
            if points is not None:
                np.save(folder / f"{name}-{role}.npy", points)
        lines.append(f"{name},{name}-a.npy,{name}-b.npy")
    (folder / "pairs.csv").write_text("\n".join(lines))
    return {"files": {"pairs": str(folder / "pairs.csv")}}


def two_scans(seed):
    pair = novelty.simulation.simulate_pair("room", seed, ("box",), noise=0.01, density=0.03).scans
    return pair.reference.points, pair.current.points


def test_rows_are_those_of_single_runs(small, finished):
    rows = {(r["pair"], r["axes"]): r for r in read_rows(finished[0]).to_pylist()}
    assert len(rows) == 8
    for pair in pairs_of(small):
        scans = pair.load()
        for setting in settings_of(small):
            row = rows[pair.name, json.dumps(setting.axes, sort_keys=True, separators=(",", ":"))]
            result = novelty.detect(scans, setting.config)
            added = novelty.evaluation.evaluate_labels(scans.current.labels, result.added.point_labels)
            assert row["added_kappa"] == pytest.approx(added.scores.kappa, abs=1e-12)
            assert row["added_novel_points"] == result.added.point_labels.sum()
            details = result.details["reference"]
            assert row["reference_components"] == details["num_components"]
            assert row["reference_mdl"] == pytest.approx(details["mdl"], rel=1e-9)
            path = [v if v is not None else np.nan for v in row["reference_mdl_path"]]
            np.testing.assert_allclose(path, details["mdl_path"], rtol=1e-9)
            assert row["status"] in (OK, NOTED)
            assert row["seconds"] > 0 < row["peak_memory"]


def test_shared_stages_are_made_once(small, monkeypatch):
    calls = {"prepare_pairs": 0, "register": 0}

    def counted(name):
        function = getattr(stages, name)

        def wrapped(*args):
            calls[name] += 1
            return function(*args)

        return wrapped

    for name in calls:
        monkeypatch.setattr(stages, name, counted(name))
    fits = []
    fit_mdl = stages.FitPlan.once

    def noted(plan, what, fit):
        fits.append((what, what in plan.made, len(plan.max_components)))
        return fit_mdl(plan, what, fit)

    monkeypatch.setattr(stages.FitPlan, "once", noted)
    axes = small.to_mapping() | {
        "grid": {
            "detector": ["likelihood", "greedy_emd", "structural_matching", "joint_mixture"],
            "max_components": [3, 5],
        },
        "configuration": {"registration.method": "none", "fit.initializer": "random_points"},
        "repetitions": 2,
    }
    described = Sweep.from_mapping(axes)
    pairs = [pair.load() for pair in pairs_of(described)]
    outcomes = list(compute(Prepared.of(pairs, settings_of(described), None), None))
    assert len(outcomes) == 32
    assert calls == {"prepare_pairs": 1, "register": 1}
    made = [what for what, known, _ in fits if not known]
    assert len(set(made)) == len(made) < len(fits)
    assert made.count("united") == 1  # what joint_mixture and the coupled detectors begin with
    assert {members for *_, members in fits} == {
        8
    }  # two pairs at two orders with two seeds are one tensor batch
    monkeypatch.undo()
    for one in outcomes[::5]:
        alone = novelty.detect(pairs[one.place], one.setting.config)
        np.testing.assert_array_equal(one.result.added.point_scores, alone.added.point_scores)


def test_nothing_is_run_twice(small, finished, finished_copy):
    _, first = finished
    again = run_sweep(small, finished_copy, HERE)
    assert (first.computed, again.computed, again.finished_before, again.left) == (8, 0, 8, 0)
    more = Sweep.from_mapping(small.to_mapping() | {"repetitions": 2})
    assert run_sweep(more, finished_copy, HERE).computed == 8
    assert len(read_rows(finished_copy)) == 16


def test_a_stopped_sweep_goes_on_where_it_was(small, finished, tmp_path):
    asked = iter([False, True, True, True])
    stopped = run_sweep(small, tmp_path / "stopped", HERE, stopping=lambda: next(asked))
    assert 0 < stopped.left < 8
    assert run_sweep(small, tmp_path / "stopped", HERE).computed == stopped.left
    assert same(outcome(tmp_path / "stopped"), outcome(finished[0]))


def test_bad_pairs_are_rows_with_their_reason(tmp_path):
    good = two_scans(1)
    data = listed(
        tmp_path,
        {
            "good": good,
            "nan": (np.full((10, 3), np.nan), good[1]),
            "missing": (good[0], None),
            "fine": two_scans(2),
        },
    )
    (tmp_path / "good-x.npy").write_bytes(b"not an array")
    described = Sweep.from_mapping({"data": data, "grid": {"max_components": [3, 4]}})
    summary = run_sweep(described, tmp_path / "out", HERE)
    rows = read_rows(tmp_path / "out").to_pylist()
    told = {row["pair"]: (row["status"], row["message"]) for row in rows}
    assert summary.failed == 4
    assert len(rows) == 8
    assert told["missing"][0] == FAILED
    assert "missing-b.npy" in told["missing"][1]
    assert told["nan"][0] == FAILED
    assert "finite" in told["nan"][1]
    assert told["good"][0] in (OK, NOTED)


def test_failures_are_retried_on_request(tmp_path):
    good = two_scans(1)
    data = listed(tmp_path, {"good": good, "late": (good[0], None)})
    described = Sweep.from_mapping({"data": data, "configuration": {"max_components": 3}})
    assert run_sweep(described, tmp_path / "out", HERE).failed == 1
    kept = run_sweep(described, tmp_path / "out", HERE)
    assert (kept.computed, kept.failed_before) == (0, 1)
    again = run_sweep(described, tmp_path / "out", RunOptions(workers=0, retry_failed=True))
    assert (again.computed, again.failed) == (1, 1)
    assert max(read_rows(tmp_path / "out")["attempt"].to_pylist()) == 2
    np.save(tmp_path / "late-b.npy", good[1])
    assert run_sweep(described, tmp_path / "out", HERE).failed == 0
    assert set(read_rows(tmp_path / "out")["status"].to_pylist()) <= {OK, NOTED}


@pytest.mark.parametrize(("error", "status"), [(MemoryError, OUT_OF_MEMORY), (ValueError, FAILED)])
def test_a_run_that_breaks_is_found_and_the_others_go_on(small, tmp_path, monkeypatch, error, status):
    compare = stages.compare_fitted

    def breaking(pairs, batch, registrations, models, config, clock, measured):
        if config.max_components == 8 and any(pair.name == "room-1" for pair in pairs):
            raise error("too much")
        return compare(pairs, batch, registrations, models, config, clock, measured)

    monkeypatch.setattr(stages, "compare_fitted", breaking)
    summary = run_sweep(small, tmp_path, HERE)
    failed = [row for row in read_rows(tmp_path).to_pylist() if row["status"] == status]
    assert (summary.computed, summary.failed) == (8, 2)
    assert {(row["pair"], row["max_components"]) for row in failed} == {("room-1", 8)}
    assert all("too much" in row["message"] for row in failed)


def test_a_full_disk_stops_with_a_message_and_keeps_what_is_finished(small, tmp_path, monkeypatch):
    count = 0

    def fsync(_descriptor):
        nonlocal count
        count += 1
        if count > 2:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr("novelty.sweep.store.os.fsync", fsync)
    with pytest.raises(StoreError, match="No space left on device"):
        run_sweep(small, tmp_path, HERE)
    monkeypatch.undo()
    assert run_sweep(small, tmp_path, HERE).finished_before == 4


def test_a_damaged_shard_is_said_and_its_runs_are_computed_again(small, finished_copy):
    before = outcome(finished_copy)
    shard = sorted(SweepFolder(finished_copy).rows.iterdir())[0]
    shard.write_bytes(shard.read_bytes()[:1000])
    again = run_sweep(small, finished_copy, HERE)
    assert [path.name for path in again.damaged] == [shard.name]
    assert again.computed == 4
    assert same(outcome(finished_copy), before)


def test_labels_and_mixtures_are_kept_on_request(small, tmp_path):
    run_sweep(Sweep.from_mapping(small.to_mapping() | {"keep": ["labels", "mixtures"]}), tmp_path, HERE)
    folder = SweepFolder(tmp_path)
    for row in read_rows(tmp_path).to_pylist():
        with (
            np.load(folder.scans_file(row["inputs"])) as scans,
            np.load(folder.result_file(row["key"])) as kept,
        ):
            assert len(kept["added_states"]) == len(scans["current_points"]) == row["current_points"]
            assert np.isin(kept["added_states"], (1, 4)).sum() == row["added_novel_points"]
            assert len(kept["removed_means"]) == row["reference_components"]


def test_the_plan_keeps_to_its_limits(small):
    many = Sweep.from_mapping(small.to_mapping() | {"repetitions": 10})
    plan = make_plan(many, RunOptions(workers=1, batch_seconds=0.2))
    assert plan.num_runs == sum(batch.num_runs for batch in plan.batches) == 80
    assert max(batch.cost.seconds for batch in plan.batches) < 0.3
    runs = {(pair.name, s.index) for batch in plan.batches for pair in batch.pairs for s in batch.settings}
    assert len(runs) == 80
    little = make_plan(many, RunOptions(workers=1, memory=6.1e8))
    assert all(len(batch.pairs) == 1 for batch in little.batches)


def started(sweep_file, out, *options):
    command = [
        sys.executable,
        "-c",
        "from novelty.cli import main; main()",
        "sweep",
        str(sweep_file),
        "--out",
        str(out),
    ]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "COLUMNS": "200"}
    return subprocess.Popen(
        [*command, *options], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def wait_for_shards(out, count, process):
    deadline = time.monotonic() + 120
    while len(list((out / "rows").glob("[!.]*.parquet"))) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.slow
def test_killed_at_any_moment_the_same_command_continues(small_file, small, tmp_path):
    changes = ("data.rooms.count=12",)
    for shards in (1, 2):
        process = started(small_file, tmp_path / "killed", *changes, "--workers", "1")
        wait_for_shards(tmp_path / "killed", shards, process)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    process = started(small_file, tmp_path / "killed", *changes, "--workers", "1")
    told, _ = process.communicate()
    assert process.returncode == 0
    assert not told.startswith("0 runs")
    whole = Sweep.from_mapping(small.to_mapping())
    whole = Sweep.from_mapping(
        whole.to_mapping() | {"data": {"rooms": whole.to_mapping()["data"]["rooms"] | {"count": 12}}}
    )
    run_sweep(whole, tmp_path / "whole", HERE)
    assert same(outcome(tmp_path / "killed"), outcome(tmp_path / "whole"))
    shards = [pa.parquet.read_table(f) for f in (tmp_path / "killed" / "rows").glob("[!.]*.parquet")]
    assert sum(map(len, shards)) == 48  # none twice, none missing


@pytest.mark.slow
def test_ctrl_c_ends_cleanly_and_says_how_to_continue(small_file, tmp_path):
    process = started(small_file, tmp_path / "out", "data.rooms.count=6", "--workers", "1")
    wait_for_shards(tmp_path / "out", 1, process)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate()
    assert process.returncode == 130
    assert "To continue: novelty sweep" in told.replace("\n", " ")
    assert "data.rooms.count=6" in told


@pytest.mark.slow
def test_a_scan_that_takes_all_memory_is_a_row(tmp_path):
    good = two_scans(1)
    rng = np.random.default_rng(0)
    data = listed(tmp_path, {"good": good, "huge": (rng.normal(size=(30_000_000, 3)).astype("f4"), good[1])})
    described = Sweep.from_mapping({"data": data, "configuration": {"max_components": 3}})
    summary = run_sweep(described, tmp_path / "out", RunOptions(workers=1, memory=1.5e9))
    told = {row["pair"]: row["status"] for row in read_rows(tmp_path / "out").to_pylist()}
    assert told == {"good": told["good"], "huge": OUT_OF_MEMORY}
    assert told["good"] in (OK, NOTED)
    assert summary.failed == 1
