"""The executor of many machines: Ray actors, one batch at a time each (extra `[ray]`)."""

from __future__ import annotations

import socket
from typing import Any

from novelty.errors import MissingDependencyError, NoveltyError
from novelty.sweep.batch import Batch
from novelty.sweep.executor import Done, Executor, answer
from novelty.sweep.processes import WorkerOptions
from novelty.sweep.worker import Worker


class Cluster(Executor):
    """One Ray actor per seat; one that is lost is replaced, and its batch reported as lost."""

    def __init__(self, seats: int | None, address: str | None, options: WorkerOptions) -> None:
        """Connect and start the actors.

        Args:
            seats: How many actors; None: one per core of the cluster.
            address: Of a running cluster; None: one on this machine, for the time of the sweep.
            options: How each is set up.

        Raises:
            MissingDependencyError: Ray is not installed.
            NoveltyError: There is no cluster at this address.
        """
        self._ray = _ray()
        self._connect(address, seats)
        self._options = options
        cores = int(self._ray.cluster_resources().get("CPU", 1))
        self._actors = [self._start() for _ in range(seats or cores)]
        self._running: dict[Any, int] = {}

    @property
    def seats(self) -> int:
        """One per actor."""
        return len(self._actors)

    def submit(self, seat: int, batch: Batch, upcoming: Batch | None) -> None:
        """Give the batch to the actor."""
        self._running[self._actors[seat].compute.remote(batch, upcoming)] = seat

    def wait(self, seconds: float) -> list[Done]:
        """What the actors have sent, or that they are no more."""
        ready, _ = (
            self._ray.wait(list(self._running), num_returns=1, timeout=seconds) if self._running else ([], [])
        )
        return [self._received(answered, self._running.pop(answered)) for answered in ready]

    def close(self) -> None:
        """End the actors and leave the cluster."""
        for actor in self._actors:
            self._ray.kill(actor)
        self._ray.shutdown()

    def _received(self, answered: Any, seat: int) -> Done:
        try:
            rows, error = self._ray.get(answered)
        except self._ray.exceptions.RayError as lost:
            self._actors[seat] = self._start()
            return Done(seat, lost=f"the worker was lost: {str(lost).splitlines()[0]}")
        return Done(seat, rows, error=error)

    def _connect(self, address: str | None, seats: int | None) -> None:
        if address is None:
            self._ray.init(
                num_cpus=seats, include_dashboard=False, log_to_driver=False, logging_level="ERROR"
            )
            return
        try:
            _knock(address)
            self._ray.init(address=address, log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, OSError, ValueError, RuntimeError) as error:
            raise NoveltyError(
                f"no Ray cluster at {address!r}: {error}. Start one with `ray start --head`."
            ) from None

    def _start(self) -> Any:
        actor = self._ray.remote(num_cpus=1, max_restarts=0)(_Actor)
        return actor.remote(self._options)


class _Actor:
    """A worker at the other end."""

    def __init__(self, options: WorkerOptions) -> None:
        self._worker = Worker(options.folder, options.keep)

    def compute(self, batch: Batch, upcoming: Batch | None) -> tuple[Any, str]:
        """Rows, and what stops the sweep."""
        done = answer(self._worker, 0, batch, upcoming)
        return done.rows, done.error


def _knock(address: str) -> None:
    """Fail at once where nobody listens at `host:port`; Ray itself would try for minutes."""
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if host and port.isdecimal():
        socket.create_connection((host, int(port)), timeout=10).close()


def _ray() -> Any:
    try:
        import ray
        import ray.exceptions
    except ImportError:
        raise MissingDependencyError(
            "the executor `ray` needs Ray, which is not installed: pip install 'novelty-gmm[ray]'"
        ) from None
    return ray
