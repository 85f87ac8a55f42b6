"""Progress: told what is done; says pairs per second, the time left and failures."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from novelty.sweep.rows import FAILURES

EVERY = 60.0
"""Seconds between two lines where there is no terminal."""


class Progress:
    """Counts what is done and shows nothing.

    Attributes:
        total: Runs of the sweep.
        done: Of these, with a row.
        failed: Of those done by this start, without an answer.
        last_failure: Name and reason of the last one.
    """

    def __init__(self, settings: int = 1, clock: Callable[[], float] = time.monotonic) -> None:
        """Count runs; so many of them are a pair."""
        self._settings, self._clock = settings, clock
        self._begun = clock()
        self._computed = 0
        self.total = self.done = self.failed = 0
        self.last_failure = ""

    def begin(self, total: int, damaged: Sequence[Path]) -> None:
        """A sweep of so many runs begins; these shards were damaged."""
        self.total, self._begun = total, self._clock()

    def skip(self, runs: int) -> None:
        """These runs were done by an earlier start."""
        self.done += runs

    def advance(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """These rows are stored."""
        self.done += len(rows)
        self._computed += len(rows)
        for row in rows:
            if row["status"] in FAILURES:
                self.failed += 1
                self.last_failure = f"{row['pair']}: {row['message']}"

    def end(self) -> None:
        """Nothing more will be done."""

    @property
    def pairs_per_second(self) -> float:
        """Pairs with all their settings, since the start."""
        return self._computed / self._settings / max(self._clock() - self._begun, 1e-9)

    @property
    def time_left(self) -> str:
        """At the pace so far."""
        if not self._computed:
            return "unknown"
        left = (self.total - self.done) / self._settings / self.pairs_per_second
        return str(timedelta(seconds=round(left)))


class LiveProgress(Progress):
    """A bar on a terminal, brought up to date several times a second."""

    def __init__(self, settings: int, console: Console) -> None:
        """Show on this console."""
        super().__init__(settings)
        self._console = console
        self._live = Live(get_renderable=self._view, console=console, refresh_per_second=4, transient=True)

    def begin(self, total: int, damaged: Sequence[Path]) -> None:
        """Begin to show."""
        super().begin(total, damaged)
        self._live.start()

    def end(self) -> None:
        """Take the bar away."""
        self._live.stop()

    def _view(self) -> Table:
        view = Table.grid(padding=(0, 2))
        view.add_row(
            ProgressBar(total=max(self.total, 1), completed=self.done, width=24),
            f"{self.done} of {self.total} runs",
            f"{self.pairs_per_second:.3g} pairs/s",
            f"left {self.time_left}",
            f"[red]{self.failed} failed[/]" if self.failed else "",
        )
        return view


class LineProgress(Progress):
    """One line a minute."""

    def __init__(
        self, settings: int, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Say the lines by this function."""
        super().__init__(settings, clock)
        self._say = say
        self._said = self._begun

    def advance(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Say a line when the last is a minute old."""
        super().advance(rows)
        if self._clock() - self._said >= EVERY:
            self._said = self._clock()
            self._say(self.line())

    def line(self) -> str:
        """How far the sweep is."""
        parts = [
            f"{self.done} of {self.total} runs",
            f"{self.pairs_per_second:.3g} pairs/s",
            f"left {self.time_left}",
        ]
        if self.failed:
            parts.append(f"{self.failed} failed, last {self.last_failure}")
        return ", ".join(parts)
