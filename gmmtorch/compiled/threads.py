"""Shares of a compiled loop on several threads; the loops do not hold the interpreter's lock."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import torch

__all__ = ["shared_out"]

_SPLIT_ABOVE = 1 << 17  # points times components: below, a second thread costs more than it saves


def shared_out(loop: Callable[[int, int], None], count: int, work: int) -> None:
    """Run loop(first, last) over `count` independent pieces, on as many threads as torch may use.

    Args:
        loop: makes the pieces from first to last - 1.
        count: number of pieces.
        work: points times components in all of them.
    """
    threads = min(torch.get_num_threads(), count)
    if threads <= 1 or work < _SPLIT_ABOVE:
        loop(0, count)
        return
    cuts = [i * count // threads for i in range(threads + 1)]
    others = [_pool(threads).submit(loop, *cut) for cut in itertools.pairwise(cuts[1:])]
    loop(0, cuts[1])
    for other in others:
        other.result()


@lru_cache(maxsize=1)
def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads beside the caller's."""
    return ThreadPoolExecutor(threads - 1, thread_name_prefix="gmmtorch")
