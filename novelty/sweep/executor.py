"""What an executor is: seats at which workers compute batches; and the one that needs no other process."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from dataclasses import dataclass

from novelty.sweep.batch import Batch
from novelty.sweep.folder import SweepFolder
from novelty.sweep.worker import Row, Worker


@dataclass(frozen=True, eq=False)
class Done:
    """What a seat reports about the batch it was given.

    Attributes:
        seat: Which seat.
        rows: The rows; None when there are none.
        lost: Why the worker is no more; the seat has a new one.
        error: What stops the whole sweep, such as a full disk.
    """

    seat: int
    rows: Sequence[Row] | None = None
    lost: str = ""
    error: str = ""


class Executor(abc.ABC):
    """Computes batches at several seats; a seat has one batch at a time."""

    @property
    @abc.abstractmethod
    def seats(self) -> int:
        """How many batches are computed at once."""

    @abc.abstractmethod
    def submit(self, seat: int, batch: Batch, upcoming: Batch | None) -> None:
        """Give a free seat a batch; the one after it may be read meanwhile."""

    @abc.abstractmethod
    def wait(self, seconds: float) -> list[Done]:
        """What is done after so many seconds at most, or as soon as something is."""

    @abc.abstractmethod
    def close(self) -> None:
        """End all workers."""


class InProcess(Executor):
    """One seat, in this process and thread."""

    def __init__(self, folder: SweepFolder, keep: tuple[str, ...] = ()) -> None:
        """Set the seat up; see `Worker`."""
        self._worker = Worker(folder, keep)
        self._given: tuple[Batch, Batch | None] | None = None

    @property
    def seats(self) -> int:
        """One."""
        return 1

    def submit(self, seat: int, batch: Batch, upcoming: Batch | None) -> None:
        """Take the batch; it is computed in `wait`."""
        self._given = batch, upcoming

    def wait(self, seconds: float) -> list[Done]:
        """Compute the batch, however long it takes."""
        if self._given is None:
            return []
        given, self._given = self._given, None
        return [answer(self._worker, 0, *given)]

    def close(self) -> None:
        """Stop reading ahead."""
        self._worker.close()


def answer(worker: Worker, seat: int, batch: Batch, upcoming: Batch | None) -> Done:
    """What a worker makes of a batch; what it cannot blame on a run stops the sweep."""
    try:
        return Done(seat, worker.compute(batch, upcoming))
    except OSError as error:
        return Done(seat, error=f"{error.strerror or error}")
    except Exception as error:
        return Done(seat, error=f"{type(error).__name__}: {error}")
