"""The schedule: seats are kept busy, lost workers cost nothing, and the run that takes them down is found."""

from __future__ import annotations

import pytest

from novelty.sweep.batch import Batch
from novelty.sweep.executor import Done, Executor
from novelty.sweep.folder import SweepFolder
from novelty.sweep.inputs import HashedPair
from novelty.sweep.progress import LineProgress
from novelty.sweep.rows import FAILED, OUT_OF_MEMORY
from novelty.sweep.schedule import Schedule
from novelty.sweep.settings import settings_of
from novelty.sweep.sources import pairs_of
from novelty.sweep.store import RowStore, StoreError, read_rows
from novelty.sweep.sweep import Sweep
from novelty.sweep.worker import lost_rows


class Scripted(Executor):
    """Answers with rows, unless one of these pairs is in the batch, which takes the worker down."""

    def __init__(self, seats=2, deadly=(), reason="killed for want of memory", error=""):
        self.count, self.deadly, self.reason, self.error = seats, set(deadly), reason, error
        self.given: dict[int, Batch] = {}
        self.log: list[tuple[str, str | None]] = []

    @property
    def seats(self):
        return self.count

    def submit(self, seat, batch, upcoming):
        assert seat not in self.given
        self.given[seat] = batch
        self.log.append((batch.name, None if upcoming is None else upcoming.name))

    def wait(self, seconds):
        seat, batch = self.given.popitem()
        if self.error:
            return [Done(seat, error=self.error)]
        if self.deadly & {hashed.pair.name for hashed in batch.pairs}:
            return [Done(seat, lost=self.reason)]
        return [Done(seat, [row | {"message": "", "status": "ok"} for row in lost_rows(batch, "", "ok")])]

    def close(self):
        pass


@pytest.fixture
def batches():
    """Four batches of three pairs under two settings."""
    data = {"rooms": {"setup": {"scene": "room", "changes": ["box"]}, "count": 12}}
    sweep = Sweep.from_mapping({"data": data, "grid": {"seed": [0, 1]}})
    pairs = [HashedPair(pair, pair.name) for pair in pairs_of(sweep)]
    return [Batch(f"{n}", tuple(pairs[3 * n : 3 * n + 3]), settings_of(sweep)) for n in range(4)]


def run(batches, executor, folder, stopping=lambda: False):
    store = RowStore(SweepFolder(folder))
    return [row for rows in Schedule(iter(batches), executor, store).run(stopping) for row in rows]


@pytest.mark.parametrize("seats", [1, 2, 7])
def test_every_run_gets_one_row(batches, tmp_path, seats):
    rows = run(batches, Scripted(seats), tmp_path)
    assert len(rows) == len({row["key"] for row in rows}) == 24
    assert len(read_rows(tmp_path)) == 24


def test_a_seat_knows_its_next_batch(batches, tmp_path):
    executor = Scripted(1)
    run(batches, executor, tmp_path)
    assert executor.log == [("0", "1"), ("1", "2"), ("2", "3"), ("3", None)]


@pytest.mark.parametrize(
    ("reason", "status"), [("for want of memory", OUT_OF_MEMORY), ("exit code 1", FAILED)]
)
def test_the_pair_that_takes_workers_down_is_found_and_the_others_have_rows(
    batches, tmp_path, reason, status
):
    executor = Scripted(2, deadly=["rooms-4"], reason=reason)
    rows = run(batches, executor, tmp_path)
    failed = [row for row in rows if row["status"] != "ok"]
    assert len(rows) == len({row["key"] for row in rows}) == 24
    assert [row["pair"] for row in failed] == ["rooms-4"] * 2
    assert {row["status"] for row in failed} == {status}
    assert reason in failed[0]["message"]


def test_a_worker_lost_by_accident_costs_one_more_try(batches, tmp_path):
    class Once(Scripted):
        def wait(self, seconds):
            done = super().wait(seconds)
            self.deadly = set()
            return done

    executor = Once(1, deadly=["rooms-0", "rooms-1"])
    rows = run(batches, executor, tmp_path)
    assert {row["status"] for row in rows} == {"ok"}
    assert [name for name, _ in executor.log].count("0") == 2


def test_stopping_ends_after_the_batches_at_work(batches, tmp_path):
    asked = iter([False, True, True, True, True])
    assert len(run(batches, Scripted(2), tmp_path, lambda: next(asked))) == 12


def test_what_is_no_run_s_fault_stops_the_sweep(batches, tmp_path):
    with pytest.raises(StoreError, match=r"No space left.*safe.*same command"):
        run(batches, Scripted(1, error="No space left on device"), tmp_path)


def test_one_line_a_minute_without_a_terminal():
    now, said = [0.0], []
    progress = LineProgress(2, said.append, clock=lambda: now[0])
    progress.begin(20, [])
    progress.skip(4)
    for seconds in (30, 61, 90, 125):
        now[0] = seconds
        progress.advance([{"status": "ok"}, {"status": "failed", "pair": "a", "message": "why"}])
    assert said == [
        "8 of 20 runs, 0.0328 pairs/s, left 0:03:03, 2 failed, last a: why",
        "12 of 20 runs, 0.032 pairs/s, left 0:02:05, 4 failed, last a: why",
    ]
