"""What must not be lost: a command never writes over a file that it reads."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from novelty.errors import InputError
from novelty.io.address import ScanAddress


def refuse_overwriting(outputs: Iterable[str | Path], inputs: Iterable[str | Path], instead: str) -> None:
    """Make sure that no output is one of the inputs, by whatever name and link; a missing file is none.

    Args:
        outputs: Files that will be written.
        inputs: Files that are read; of a scan in a file of several scans, its address.
        instead: What to do about it, such as "choose another folder".

    Raises:
        InputError: An output is one of the inputs.
    """
    read = [ScanAddress.parse(path).file for path in inputs]
    for output in map(Path, outputs):
        if any(_is_same(output, path) for path in read):
            raise InputError(f"{output}: this is an input, and the results would overwrite it; {instead}.")


def _is_same(one: Path, other: Path) -> bool:
    return one.exists() and other.exists() and os.path.samefile(one, other)
