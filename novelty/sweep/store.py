"""The store: finished runs as Parquet shards that appear whole or not at all, and are never changed.

Nothing is shared between writers: every shard has a name of its own, so that any number of sweeps may write into one
folder. A run that two of them finished is there twice, and counts once.
"""

from __future__ import annotations

import logging
import os
import socket
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from novelty.errors import InputError, NoveltyError
from novelty.sweep.folder import SweepFolder
from novelty.sweep.rows import FAILURES, SCHEMA, as_table

_log = logging.getLogger(__name__)

RUN = ("data", "pair", "configuration", "repetition")
"""What a run is, whatever the version of the code and the content of the scans; its latest row counts."""


class StoreError(NoveltyError):
    """Rows could not be written; those of the batches before are safe."""


@dataclass(frozen=True)
class Finished:
    """What is known of a run that has a row."""

    status: str
    attempt: int

    @property
    def failed(self) -> bool:
        """Whether there is no answer."""
        return self.status in FAILURES


class RowStore:
    """The shards of one folder, as far as this process has seen them.

    Attributes:
        finished: The last attempt of every run, by key.
        damaged: Shards that could not be read and were set aside; their runs count as not done.
    """

    def __init__(self, folder: SweepFolder) -> None:
        """Read what is finished; shards that cannot be read are moved to the folder of damaged ones."""
        self.folder = folder
        self.finished: dict[str, Finished] = {}
        self.damaged: list[Path] = []
        self._seen: set[str] = set()
        self.refresh()

    def refresh(self) -> None:
        """Take note of the shards that have appeared since, another sweep's included."""
        for shard in _shards(self.folder):
            if shard.name not in self._seen:
                self._seen.add(shard.name)
                self._take_note(shard)

    def write(self, rows: Sequence[Mapping[str, Any]]) -> Path:
        """Write rows as one shard; when this returns they survive a power cut.

        Raises:
            StoreError: The disk is full, or the folder cannot be written.
        """
        shard = self.folder.rows / f"{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex[:12]}.parquet"
        try:
            _write_durably(as_table(rows), shard)
        except OSError as error:
            raise StoreError(
                f"{shard.parent}: the rows of {len(rows)} runs cannot be written: {error.strerror or error}. "
                "All rows before them are safe: make room, then give the same command again to continue."
            ) from error
        self._seen.add(shard.name)
        self._record((row["key"], row["status"], row["attempt"]) for row in rows)
        return shard

    def _take_note(self, shard: Path) -> None:
        try:
            columns = _read_shard(shard).select(["key", "status", "attempt"]).to_pydict()
        except (pa.ArrowException, OSError) as error:
            self._set_aside(shard, error)
        else:
            self._record(zip(columns["key"], columns["status"], columns["attempt"], strict=True))

    def _record(self, rows: Iterable[tuple[str, str, int]]) -> None:
        for key, status, attempt in rows:
            known = self.finished.get(key)
            if known is None or attempt >= known.attempt:
                self.finished[key] = Finished(status, attempt)

    def _set_aside(self, shard: Path, error: Exception) -> None:
        place = self.folder.damaged / shard.name
        self.folder.damaged.mkdir(parents=True, exist_ok=True)
        os.replace(shard, place)
        self.damaged.append(place)
        _log.info("%s was set aside: %s", place, error)


def read_rows(root: str | Path) -> pa.Table:
    """The rows of a sweep's folder, one per run: its latest attempt. Nothing in the folder is changed.

    Shards that cannot be read are left out with a warning; the next `novelty sweep` computes their runs again.

    Raises:
        InputError: The folder holds no rows.
    """
    folder = SweepFolder(Path(root))
    tables = [table for shard in _shards(folder) if (table := _readable(shard)) is not None]
    if not tables:
        raise InputError(f"{folder.rows}: there are no rows. Name the folder given to `novelty sweep --out`.")
    return _latest(pa.concat_tables(tables))


def _latest(rows: pa.Table) -> pa.Table:
    """The last row of every run, by attempt and time, in the order in which the runs were finished."""
    rows = rows.sort_by([("finished", "ascending"), ("attempt", "ascending")])
    numbered = rows.select(list(RUN)).append_column("place", pa.array(range(len(rows)), pa.int64()))
    last = numbered.group_by(list(RUN), use_threads=False).aggregate([("place", "max")])
    places = last["place_max"]
    return rows.take(pc.take(places, pc.sort_indices(places)))


def _shards(folder: SweepFolder) -> list[Path]:
    return sorted(folder.rows.glob("[!.]*.parquet"))


def _readable(shard: Path) -> pa.Table | None:
    try:
        return _read_shard(shard)
    except (pa.ArrowException, OSError) as error:
        _log.warning("%s is damaged (%s); its rows are left out.", shard, error)
        return None


def _read_shard(shard: Path) -> pa.Table:
    """A shard whose every page has the checksum it was written with, in the columns of the schema."""
    table = pq.read_table(shard, page_checksum_verification=True, partitioning=None)
    known = set(table.column_names)
    columns = [
        table[field.name].cast(field.type) if field.name in known else pa.nulls(len(table), field.type)
        for field in SCHEMA
    ]
    return pa.table(columns, schema=SCHEMA)


def _write_durably(table: pa.Table, target: Path) -> None:
    """Temporary file, fsync, rename, fsync of the folder: half a shard is never seen."""
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.name}.tmp")
    try:
        with temporary.open("wb") as file:
            pq.write_table(table, file, compression="zstd", write_page_checksum=True)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
