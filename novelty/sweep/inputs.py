"""What a run is computed from, as hashes: the content of the scans, and the code."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

from novelty import __version__
from novelty.io import FailedPair, PairEntry
from novelty.sweep.folder import SweepFolder
from novelty.sweep.settings import Setting, canonical_json
from novelty.sweep.sources import SweepPair

PACKAGES = ("gmmtorch", "novelty")
BESIDE_THE_COMPUTATION = ("cli", "report")
"""Parts of `novelty` that have no say in what is computed."""


@cache
def code_version() -> str:
    """The version of novelty and a hash of every source file that has a say in what is computed."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        root = Path(str(files(package)))
        for file in sorted(root.rglob("*.py")):
            place = file.relative_to(root)
            if place.parts[0] not in BESIDE_THE_COMPUTATION:
                digest.update(f"{package}/{place.as_posix()}\n".encode() + file.read_bytes())
    return f"{__version__}+{digest.hexdigest()[:12]}"


@dataclass(frozen=True)
class HashedPair:
    """A pair and the hash of its content."""

    pair: SweepPair
    inputs: str


def run_key(hashed: HashedPair, setting: Setting) -> str:
    """The key of a run: the pair by name and by content, configuration, repetition and code."""
    parts = (hashed.pair.data, hashed.pair.name, hashed.inputs, setting.digest, code_version())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


class InputHashes:
    """Hashes of the content of pairs; a file is read again only when its size or its time has changed."""

    def __init__(self, folder: SweepFolder) -> None:
        """Read what is known from earlier starts."""
        self._file = folder.inputs_file
        self._known: dict[str, str] = dict(_lines(self._file))

    def of(self, pair: SweepPair) -> str:
        """Hash of everything about a pair that a run can see.

        A pair that cannot be read has the hash of its reason, so that it is tried anew when the reason is gone.
        """
        source = pair.source
        if isinstance(source, FailedPair):
            return _hash(pair.unit, "unusable", str(source.error))
        if not isinstance(source, PairEntry):
            return _hash("simulated", source.seed, str(source.case.setup))
        try:
            contents = [self._content(file) for file in source.files()]
        except OSError as error:
            return _hash(pair.unit, "unreadable", str(error))
        scans = (str(source.reference), str(source.current))
        return _hash(pair.unit, source.reference_origin, source.current_origin, *contents, *map(_part, scans))

    def _content(self, file: Path) -> str:
        status = file.stat()
        identity = f"{file.resolve()} {status.st_size} {status.st_mtime_ns}"
        if identity not in self._known:
            with file.open("rb") as stream:
                self._known[identity] = hashlib.file_digest(stream, "sha256").hexdigest()
            self._remember(identity)
        return self._known[identity]

    def _remember(self, identity: str) -> None:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps([identity, self._known[identity]]) + "\n")


def _lines(file: Path) -> list[tuple[str, str]]:
    """The entries of the file; a line cut short by a kill is left out."""
    known = []
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
        try:
            identity, digest = json.loads(line)
        except ValueError:
            continue
        known.append((identity, digest))
    return known


def _part(scan: str) -> str:
    """Which scan of a file of several is meant, as `novelty.io.address` writes it."""
    return scan.partition("#")[2]


def _hash(*parts: object) -> str:
    return hashlib.sha256(canonical_json(parts).encode()).hexdigest()[:32]
