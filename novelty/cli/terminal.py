"""What the commands share of the terminal: answers on stdout, progress and complaints on stderr."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def complain(message: str) -> None:
    """Print an error as one message; never a traceback."""
    err.print(f"[bold red]error:[/] {escape(message)}", soft_wrap=True)


@contextmanager
def working(message: str) -> Iterator[None]:
    """Show what is being waited for; nothing is written when stderr is not a terminal."""
    if not err.is_terminal:
        yield
        return
    with err.status(escape(message)):
        yield


def command_line() -> str:
    """The command that runs now, ready to be pasted into a shell."""
    return shlex.join(["novelty", *sys.argv[1:]])


def plain_table(gap: int = 2) -> Table:
    """A table without frame; `gap` spaces between columns."""
    return Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, gap - 1, 0, 0))
