"""The schedule: keeps every seat busy, stores what is done, and finds the run that takes workers down."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace

from novelty.sweep.batch import Batch
from novelty.sweep.executor import Done, Executor
from novelty.sweep.rows import FAILED, OUT_OF_MEMORY
from novelty.sweep.store import RowStore, StoreError
from novelty.sweep.worker import Row, lost_rows

PATIENCE = 0.5
"""Seconds after which it is looked whether to stop."""


class Schedule:
    """Batches on their way through an executor into a store.

    A batch whose worker was lost is computed again, alone; one that loses its worker again is halved, until the run
    that takes workers down is a row of its own.
    """

    def __init__(self, batches: Iterator[Batch], executor: Executor, store: RowStore) -> None:
        """Take over the batches, which are made when they are needed."""
        self._batches, self._executor, self._store = batches, executor, store
        self._again: deque[Batch] = deque()
        self._current: dict[int, Batch] = {}
        self._reserved: dict[int, Batch] = {}

    def run(self, stopping: Callable[[], bool]) -> Iterator[list[Row]]:
        """The rows of every batch, each list stored when it is yielded.

        Args:
            stopping: Asked often; once it says True the batches that are being computed are the last.

        Raises:
            StoreError: Rows or what goes with them could not be written.
        """
        while True:
            if not stopping():
                self._fill()
            if not self._current:
                return
            for done in self._executor.wait(PATIENCE):
                rows = self._rows(self._current.pop(done.seat), done)
                if rows:
                    self._store.write(rows)
                    yield rows

    def _fill(self) -> None:
        """Give every free seat a batch, and know what it will be given next."""
        for seat in range(self._executor.seats):
            if seat in self._current:
                continue
            batch = self._reserved.pop(seat, None) or self._next()
            if batch is None:
                return
            upcoming = None if batch.lost else next(self._batches, None)
            if upcoming is not None:
                self._reserved[seat] = upcoming
            self._current[seat] = batch
            self._executor.submit(seat, batch, upcoming)

    def _next(self) -> Batch | None:
        """A batch to be computed again, a new one, or one that another seat has not begun."""
        if self._again:
            return self._again.popleft()
        batch = next(self._batches, None)
        if batch is None and self._reserved:
            return self._reserved.pop(max(self._reserved))
        return batch

    def _rows(self, batch: Batch, done: Done) -> list[Row]:
        if done.error:
            raise StoreError(
                f"The sweep stops: {done.error}. All rows before are safe: "
                "when the cause is gone, give the same command again to continue."
            )
        if done.rows is not None:
            return list(done.rows)
        # What was read ahead is as suspect as what was computed.
        suspects = [batch, *filter(None, [self._reserved.pop(done.seat, None)])]
        return [row for suspect in suspects for row in self._lost(suspect, done.lost)]

    def _lost(self, batch: Batch, reason: str) -> list[Row]:
        if batch.lost == 0:
            self._again.append(replace(batch, lost=1))
        elif batch.num_runs > 1:
            self._again.extend(replace(half, lost=1) for half in batch.halves())
        else:
            return lost_rows(batch, f"twice: {reason}", OUT_OF_MEMORY if "memory" in reason else FAILED)
        return []
