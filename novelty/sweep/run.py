"""A sweep from its description to its rows."""

from __future__ import annotations

import itertools
import os
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import psutil
import yaml

from novelty.environment import machine, versions
from novelty.io import write_json, write_text
from novelty.sweep.batch import Batch
from novelty.sweep.cluster import Cluster
from novelty.sweep.estimate import CostModel
from novelty.sweep.executor import Executor, InProcess
from novelty.sweep.folder import SweepFolder
from novelty.sweep.inputs import InputHashes, code_version
from novelty.sweep.plan import MAX_PAIRS, Limits, PlannedBatch, plan_batches
from novelty.sweep.processes import Processes, WorkerOptions
from novelty.sweep.progress import Progress
from novelty.sweep.rows import FAILURES
from novelty.sweep.schedule import Schedule
from novelty.sweep.settings import Setting, settings_of
from novelty.sweep.sources import SweepPair, pairs_of
from novelty.sweep.store import RowStore
from novelty.sweep.sweep import Sweep

SHARE_OF_MEMORY = 0.6
"""Of this machine's memory, for all workers together, where no budget is given."""

BATCHES_PER_SEAT = 4
"""At least so many, where there are enough pairs, so that no seat is idle for long at the end."""


@dataclass(frozen=True)
class RunOptions:
    """How a sweep is run; nothing here changes its rows.

    Attributes:
        executor: `local`: processes of this machine; `ray`: actors of a Ray cluster.
        workers: How many; 0: everything in this process; None: one per core.
        address: Of the Ray cluster; None: one on this machine for the time of the sweep.
        memory: Bytes for all workers of a machine together; None: 60 % of what it has.
        batch_seconds: About how long a batch may take, which is what a kill can lose.
        retry_failed: Whether runs that failed are tried again.
    """

    executor: Literal["local", "ray"] = "local"
    workers: int | None = None
    address: str | None = None
    memory: float | None = None
    batch_seconds: float = 60.0
    retry_failed: bool = False

    @property
    def seats(self) -> int:
        """Batches that this machine computes at once."""
        return cores() if self.workers is None else max(1, self.workers)


@dataclass(frozen=True, eq=False)
class Plan:
    """All that is to be done, whatever is done already.

    Attributes:
        pairs: Every pair.
        settings: Every configuration in every repetition.
        batches: What is computed together.
        seats: Batches that are computed at once.
    """

    pairs: tuple[SweepPair, ...]
    settings: tuple[Setting, ...]
    batches: tuple[PlannedBatch, ...]
    seats: int

    @property
    def num_runs(self) -> int:
        """Number of rows."""
        return len(self.pairs) * len(self.settings)

    @property
    def seconds(self) -> float:
        """Estimated wall time with all seats busy."""
        return sum(batch.cost.seconds for batch in self.batches) / self.seats

    @property
    def memory(self) -> float:
        """Estimated bytes of all workers together."""
        return self.seats * max((batch.cost.memory for batch in self.batches), default=0.0)


@dataclass(frozen=True)
class Summary:
    """What a start of a sweep has done.

    Attributes:
        runs: Of the sweep.
        finished_before: Of these, done by earlier starts.
        computed: Done by this start.
        failed: Of these, without an answer.
        failed_before: Of those done earlier, without an answer.
        seconds: Wall time.
        damaged: Shards that could not be read and were set aside.
    """

    runs: int
    finished_before: int
    computed: int
    failed: int
    failed_before: int
    seconds: float
    damaged: tuple[Path, ...]

    @property
    def left(self) -> int:
        """Runs that have no row yet."""
        return self.runs - self.finished_before - self.computed


def make_plan(sweep: Sweep, options: RunOptions) -> Plan:
    """Name every pair, every setting and every batch of a sweep; reads one pair of each entry of `data`.

    Raises:
        NoveltyError: A key, a value or a file named in the sweep is not valid.
    """
    settings, pairs = settings_of(sweep), pairs_of(sweep)
    budget = options.memory or SHARE_OF_MEMORY * psutil.virtual_memory().total
    share = -(-len(pairs) // (BATCHES_PER_SEAT * options.seats))
    limits = Limits(budget / options.seats, options.batch_seconds, max(1, min(MAX_PAIRS, share)))
    return Plan(
        pairs, settings, tuple(plan_batches(pairs, settings, CostModel(pairs), limits)), options.seats
    )


def run_sweep(
    sweep: Sweep,
    root: str | Path,
    options: RunOptions | None = None,
    progress: Progress | None = None,
    stopping: Callable[[], bool] = lambda: False,
    command: str = "",
    plan: Plan | None = None,
) -> Summary:
    """Compute every row of a sweep that its folder does not hold yet.

    Args:
        sweep: What to run.
        root: The folder; see `novelty.sweep.folder`.
        options: How to run it.
        progress: Told what is done; None: nobody is.
        stopping: Asked often; once it says True the batches that are being computed are the last.
        command: Kept with the start, for whoever wants to reproduce it.
        plan: What `make_plan` made of the same sweep and options, where it is known already.

    Raises:
        NoveltyError: The sweep is not valid, or rows could not be written.
    """
    begun = time.perf_counter()
    options, folder, progress = options or RunOptions(), SweepFolder(Path(root)), progress or Progress()
    plan = plan or make_plan(sweep, options)
    _record_start(sweep, folder, plan, options, command)
    store = RowStore(folder)
    progress.begin(plan.num_runs, store.damaged)
    left = _Left(plan, InputHashes(folder), store, options.retry_failed, progress)
    batches = left.batches()
    first = next(batches, None)  # workers are started only where there is something to do
    computed = failed = 0
    if first is not None:
        with closing(_executor(folder, sweep, options)) as executor:
            for rows in Schedule(itertools.chain([first], batches), executor, store).run(stopping):
                computed += len(rows)
                failed += sum(row["status"] in FAILURES for row in rows)
                progress.advance(rows)
    progress.end()
    return Summary(
        runs=plan.num_runs,
        finished_before=left.finished,
        failed_before=left.failed,
        computed=computed,
        failed=failed,
        seconds=time.perf_counter() - begun,
        damaged=tuple(store.damaged),
    )


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Left:
    """What earlier starts have left to do, found out batch by batch.

    Attributes:
        finished: Runs that had a row.
        failed: Of these, without an answer.
    """

    def __init__(
        self, plan: Plan, hashes: InputHashes, store: RowStore, retry_failed: bool, progress: Progress
    ) -> None:
        self._plan, self._hashes, self._store = plan, hashes, store
        self._retry_failed, self._progress = retry_failed, progress
        self.finished = self.failed = 0

    def batches(self) -> Iterator[Batch]:
        """The batches that have runs without a row, when they are asked for."""
        for planned in self._plan.batches:
            left = planned.left(self._hashes, self._store, self._retry_failed)
            self.finished += left.finished
            self.failed += left.failed
            self._progress.skip(left.finished)
            yield from left.batches


def _executor(folder: SweepFolder, sweep: Sweep, options: RunOptions) -> Executor:
    if options.executor == "ray":
        return Cluster(options.workers, options.address, WorkerOptions(folder, sweep.keep))
    if options.workers == 0:
        return InProcess(folder, sweep.keep)
    memory = None if options.memory is None else options.memory / options.seats
    threads = max(1, cores() // options.seats)
    return Processes(options.seats, threads, WorkerOptions(folder, sweep.keep, memory))


def _record_start(sweep: Sweep, folder: SweepFolder, plan: Plan, options: RunOptions, command: str) -> None:
    """Write the sweep with every default, and what this start is."""
    mapping = sweep.to_mapping()
    write_text(folder.sweep_file, yaml.safe_dump(mapping, sort_keys=False, allow_unicode=True))
    now = datetime.now(UTC)
    start = {
        "started": now.isoformat(timespec="seconds"),
        "command": command,
        "options": asdict(options),
        "runs": plan.num_runs,
        "pairs": len(plan.pairs),
        "settings": len(plan.settings),
        "batches": len(plan.batches),
        "code": code_version(),
        "versions": versions(),
        "machine": machine(),
        "sweep": mapping,
    }
    write_json(folder.starts / f"{now:%Y%m%dT%H%M%S}-{uuid.uuid4().hex[:6]}.json", start)
