"""The file of a map: named arrays and a record in safetensors, never pickle, with what tells a damaged one."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty import __version__
from novelty.errors import InputError
from novelty.io.atomic import replacing
from novelty.io.reading import has_scan_extension

KIND = "novelty.SceneMap"
SUFFIX = ".safetensors"
FORMAT = "1"
"""Raised when an array or a key of the record changes its meaning."""

LONGEST_HEADER = 100_000_000
"""Bytes that the header of a safetensors file may have, by its specification."""

Arrays = dict[str, NDArray[Any]]


def save_arrays(path: str | Path, arrays: Arrays, record: Mapping[str, Any]) -> None:
    """Write the arrays and the record of a map, all at once or not at all.

    Raises:
        InputError: The file cannot be written.
    """
    from safetensors.numpy import save

    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    text = json.dumps(record)
    metadata = {
        "kind": KIND,
        "format": FORMAT,
        "novelty": __version__,
        "record": text,
        "sha256": _digest(arrays, text),
    }
    with replacing(path) as temporary:
        temporary.write_bytes(save(arrays, metadata=metadata))


def load_arrays(path: str | Path) -> tuple[Arrays, dict[str, Any]]:
    """Read what `save_arrays` wrote.

    Raises:
        InputError: The file is missing, damaged, no map, or of another format.
    """
    import safetensors

    if not Path(path).is_file():
        raise InputError(f"{path}: there is no such map; make one with `novelty fit SCAN --out {path}`.")
    try:
        with safetensors.safe_open(path, framework="np") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
    except (OSError, safetensors.SafetensorError) as error:
        if has_scan_extension(path):
            advice = f"`novelty fit {path} --out MAP{SUFFIX}` makes a map of it"
            raise InputError(f"{path}: expected a map, found a scan; {advice}.") from None
        raise InputError(f"{path}: the map is damaged or is no map ({error}). Copy it again.") from None
    if metadata.get("kind") != KIND:
        found = metadata.get("kind", "something unnamed")
        raise InputError(f"{path}: expected a map made by `novelty fit`, found {found}.")
    if metadata.get("format") != FORMAT:
        raise InputError(
            f"{path}: expected a map of format {FORMAT}, found format {metadata.get('format')}, written by novelty "
            f"{metadata.get('novelty', '?')}; this is {__version__}. Make the map again from its scan."
        )
    record = metadata.get("record", "")
    if metadata.get("sha256") != _digest(arrays, record):
        raise InputError(f"{path}: the map is damaged: its contents do not fit its checksum. Copy it again.")
    return arrays, json.loads(record)


def is_map(path: str | Path) -> bool:
    """Whether a file is a safetensors file, by its extension or its first bytes; it may still be no map."""
    file = Path(path)
    if file.suffix.lower() == SUFFIX:
        return True
    if not file.is_file():
        return False
    with file.open("rb") as opened:
        start = opened.read(9)
    length = int.from_bytes(start[:8], "little")
    return start[8:] == b"{" and length <= LONGEST_HEADER


def check_replaceable(path: str | Path) -> None:
    """Make sure that a map written here overwrites nothing but a map, or an empty file.

    Raises:
        InputError: The name does not end in `.safetensors`, or something else lies there.
    """
    file = Path(path)
    if file.suffix.lower() != SUFFIX:
        raise InputError(f"{file}: expected a file ending in {SUFFIX}, as which maps are written.")
    if file.is_file() and file.stat().st_size and _kind(file) != KIND:
        raise InputError(f"{file}: this is no map, and the map would overwrite it; choose another name.")


def _kind(file: Path) -> str | None:
    """What a file says it is; None where it says nothing."""
    import safetensors

    try:
        with safetensors.safe_open(file, framework="np") as opened:
            return (opened.metadata() or {}).get("kind")
    except (OSError, safetensors.SafetensorError):
        return None


def _digest(arrays: Arrays, record: str) -> str:
    digest = hashlib.sha256(record.encode())
    for name in sorted(arrays):
        digest.update(name.encode())
        digest.update(arrays[name].tobytes())
    return digest.hexdigest()
