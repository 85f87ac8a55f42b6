"""A real Ray cluster of two workers on this machine, one of which is killed in the middle."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import psutil
import pytest

from novelty.errors import NoveltyError
from novelty.sweep import read_rows
from novelty.sweep.rows import EXACT
from novelty.sweep.run import RunOptions, run_sweep
from novelty.sweep.store import RUN
from novelty.sweep.sweep import Sweep

pytest.importorskip("ray")


def actors():
    return [p for p in psutil.process_iter(["cmdline"]) if "ray::_Actor" in " ".join(p.info["cmdline"] or [])]


def kill_one_after_the_first_shard(root, killed):
    deadline = time.monotonic() + 120
    while not list((root / "rows").glob("[!.]*.parquet")) and time.monotonic() < deadline:
        time.sleep(0.02)
    own = psutil.Process().children(recursive=True)
    victims = [actor for actor in actors() if actor in own]
    os.kill(victims[0].pid, signal.SIGKILL)
    killed.append(victims[0].pid)


@pytest.mark.slow
def test_a_lost_worker_changes_no_row(small, tmp_path, monkeypatch):
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join(filter(None, [os.getcwd(), os.environ.get("PYTHONPATH")]))
    )
    mapping = small.to_mapping()
    mapping["data"]["rooms"]["count"] = 16
    sweep = Sweep.from_mapping(mapping)
    killed: list[int] = []
    killer = threading.Thread(target=kill_one_after_the_first_shard, args=(tmp_path / "ray", killed))
    killer.start()
    summary = run_sweep(sweep, tmp_path / "ray", RunOptions(executor="ray", workers=2))
    killer.join()
    assert killed
    assert (summary.computed, summary.failed) == (64, 0)
    run_sweep(sweep, tmp_path / "local", RunOptions(workers=0))
    columns = [name for name in EXACT if not name.endswith("mdl_path") and name != "key"]
    in_order = [(name, "ascending") for name in RUN]
    ray, local = (
        read_rows(tmp_path / root).sort_by(in_order).select(columns).to_pandas() for root in ("ray", "local")
    )
    numbers = local.select_dtypes("float").columns
    assert ray.drop(columns=numbers).equals(local.drop(columns=numbers))
    np.testing.assert_allclose(ray[numbers], local[numbers], rtol=1e-6)
    assert len({worker for worker in read_rows(tmp_path / "ray")["worker"].to_pylist()}) >= 2


@pytest.mark.slow
def test_no_cluster_at_an_address_is_said(small, tmp_path):
    with pytest.raises(NoveltyError, match=r"no Ray cluster at '127\.0\.0\.1:1'"):
        run_sweep(small, tmp_path, RunOptions(executor="ray", workers=1, address="127.0.0.1:1"))
