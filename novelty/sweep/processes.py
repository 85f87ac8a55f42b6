"""The executor of one machine: worker processes with one core each, which needs no server.

The stages are many small operations, which two threads compute hardly faster than one; two processes are twice as fast.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from novelty.sweep.batch import Batch
from novelty.sweep.executor import Done, Executor, answer
from novelty.sweep.folder import SweepFolder

THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class WorkerOptions:
    """How a worker is set up.

    Attributes:
        folder: Where labels and mixtures are kept.
        keep: Which of them.
        memory: Bytes that its data may take; None: no limit. Where the system knows no such limit it is not kept.
    """

    folder: SweepFolder
    keep: tuple[str, ...] = ()
    memory: float | None = None


class Processes(Executor):
    """One process per seat; one that ends unasked is replaced, and its batch reported as lost."""

    def __init__(self, seats: int, threads: int, options: WorkerOptions) -> None:
        """Start the processes.

        Args:
            seats: How many.
            threads: Threads of each.
            options: How each is set up.
        """
        self._threads, self._options = threads, options
        self._seats = [self._start() for _ in range(seats)]
        self._busy: set[int] = set()

    @property
    def seats(self) -> int:
        """One per process."""
        return len(self._seats)

    def submit(self, seat: int, batch: Batch, upcoming: Batch | None) -> None:
        """Send the batch to the process; should it be gone, `wait` says so."""
        self._busy.add(seat)
        try:
            self._seats[seat][1].send((batch, upcoming))
        except OSError:
            return

    def wait(self, seconds: float) -> list[Done]:
        """What the processes have sent, or that they are no more."""
        places = {self._seats[seat][1]: seat for seat in self._busy}
        ready = [place for place in wait(list(places), seconds) if isinstance(place, Connection)]
        return [self._received(places[place], place) for place in ready]

    def close(self) -> None:
        """End the processes."""
        for process, place in self._seats:
            place.close()
            process.terminate()
            process.join()

    def _received(self, seat: int, place: Connection) -> Done:
        self._busy.discard(seat)
        try:
            rows, error = place.recv()
        except (EOFError, OSError):
            process = self._seats[seat][0]
            process.join()
            self._seats[seat] = self._start()
            return Done(seat, lost=_reason(process.exitcode))
        return Done(seat, rows, error=error)

    def _start(self) -> tuple[BaseProcess, Connection]:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        settings = dict.fromkeys(THREADS, str(self._threads)) | {"OMP_WAIT_POLICY": "PASSIVE"}
        with _environment(settings), _interrupt_held():
            process = context.Process(target=_work, args=(theirs, self._options), daemon=True)
            process.start()
        theirs.close()
        return process, ours


def _work(place: Connection, options: WorkerOptions) -> None:
    """Compute batches until the other end is closed."""
    # Ctrl-C reaches every process of the terminal; when to stop is for the first of them to say.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _limit_memory(options.memory)
    from novelty.sweep.worker import Worker

    worker = Worker(options.folder, options.keep)
    with suppress(EOFError, OSError):  # whoever gave the batches is gone
        while True:
            batch, upcoming = place.recv()
            done = answer(worker, 0, batch, upcoming)
            place.send((done.rows, done.error))


def _limit_memory(limit: float | None) -> None:
    """Let a scan that takes all memory raise a MemoryError here, before the system ends some process."""
    if limit is not None and sys.platform == "linux":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (int(limit), int(limit)))


def _reason(exit_code: int | None) -> str:
    if exit_code == -signal.SIGKILL:
        return "the worker was killed (signal 9), most likely for want of memory"
    if exit_code is not None and exit_code < 0:
        return f"the worker was ended by {signal.Signals(-exit_code).name}"
    return f"the worker ended with exit code {exit_code}"


@contextmanager
def _interrupt_held() -> Iterator[None]:
    """Hold Ctrl-C back from the processes that are started meanwhile, through their imports; here it comes later."""
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # its start would let Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Environment variables for the processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
