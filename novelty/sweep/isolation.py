"""One run that breaks must not take others with it: what breaks is halved until the run that broke is alone."""

from __future__ import annotations

import errno
import gc
from collections.abc import Callable, Sequence
from typing import TypeVar

from novelty.sweep.rows import FAILED, OUT_OF_MEMORY
from novelty.sweep.settings import Setting

Row = TypeVar("Row")

NO_MEMORY = ("not enough memory", "can't allocate memory", "out of memory", "bad_alloc")
"""What libraries say that do not raise a MemoryError."""


def isolated(
    places: Sequence[int],
    settings: Sequence[Setting],
    compute: Callable[[Sequence[int], Sequence[Setting]], list[Row]],
    failed: Callable[[int, Setting, Exception], Row],
) -> list[Row]:
    """The rows of every place under every setting, computed in as few calls as possible.

    Args:
        places: Pairs, by their place in a batch.
        settings: What is run on each.
        compute: Makes the rows of some of the places under some of the settings, or raises.
        failed: Makes the row of a single run that raised.

    Raises:
        OSError: The disk is full, which is nobody's fault among the runs.
    """
    if not places or not settings:
        return []
    try:
        return compute(places, settings)
    except Exception as error:
        if is_disk_full(error):
            raise
        if len(places) == len(settings) == 1:
            return [failed(places[0], settings[0], error)]
    gc.collect()  # outside of the handler, so that what the traceback held is free
    if len(places) > 1:
        middle = len(places) // 2
        parts = [(places[:middle], settings), (places[middle:], settings)]
    else:
        middle = len(settings) // 2
        parts = [(places, settings[:middle]), (places, settings[middle:])]
    return [row for part in parts for row in isolated(*part, compute, failed)]


def status_of(error: Exception) -> str:
    """The status of a run that raised this."""
    told = str(error).lower()
    no_memory = isinstance(error, MemoryError) or any(words in told for words in NO_MEMORY)
    return OUT_OF_MEMORY if no_memory else FAILED


def is_disk_full(error: BaseException | None) -> bool:
    """Whether a full disk is behind an error."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            return True
        error = error.__cause__
    return False
