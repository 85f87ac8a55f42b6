"""The worker: turns batches into rows, and reads the next batch meanwhile."""

from __future__ import annotations

import gc
import os
import resource
import socket
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime
from functools import cache
from typing import Any

import psutil

from novelty.environment import machine, versions
from novelty.errors import NoveltyError
from novelty.sweep.batch import Batch
from novelty.sweep.compute import Outcome, compute
from novelty.sweep.folder import SweepFolder
from novelty.sweep.inputs import HashedPair, code_version, run_key
from novelty.sweep.isolation import isolated, status_of
from novelty.sweep.keep import keep_result, keep_scans
from novelty.sweep.reading import LoadedBatch, load
from novelty.sweep.scoring import outcome_columns
from novelty.sweep.settings import Setting, canonical_json

Row = dict[str, Any]


class Worker:
    """Computes batches one after the other; `upcoming` of one call is best the batch of the next."""

    def __init__(self, folder: SweepFolder, keep: tuple[str, ...] = ()) -> None:
        """Set up a worker.

        Args:
            folder: Where labels and mixtures are kept.
            keep: Which of them, `labels` and `mixtures`.
        """
        self._folder, self._keep = folder, keep
        self._reader = ThreadPoolExecutor(max_workers=1, thread_name_prefix="read-ahead")
        self._ahead: tuple[str, Future[LoadedBatch]] | None = None

    def compute(self, batch: Batch, upcoming: Batch | None = None) -> list[Row]:
        """The rows of all runs of a batch; `upcoming` is read and preprocessed in the background.

        Raises:
            OSError: The disk is full.
        """
        started = datetime.now(UTC)
        loaded = self._loaded(batch)
        if upcoming is not None:
            self._ahead = upcoming.name, self._reader.submit(load, upcoming)
        rows = self._rows(loaded)
        del loaded
        gc.collect()
        common = (
            _provenance()
            | _memory()
            | {"batch": batch.name, "batch_runs": batch.num_runs, "started": started}
        )
        return [row | common for row in rows]

    def close(self) -> None:
        """Stop reading ahead."""
        self._reader.shutdown(wait=False, cancel_futures=True)

    def _loaded(self, batch: Batch) -> LoadedBatch:
        ahead, self._ahead = self._ahead, None
        return ahead[1].result() if ahead is not None and ahead[0] == batch.name else load(batch)

    def _rows(self, loaded: LoadedBatch) -> list[Row]:
        batch = loaded.batch

        def failed(place: int, setting: Setting, error: Exception) -> Row:
            return _identity(batch, batch.pairs[place], setting) | _failure(error)

        def computed(places: Sequence[int], settings: Sequence[Setting]) -> list[Row]:
            outcomes = compute(loaded.prepare(places, settings), batch.unit)
            return [self._row(loaded, places[outcome.place], outcome) for outcome in outcomes]

        unusable = [
            failed(place, setting, error)
            for place, error in loaded.failures.items()
            for setting in batch.settings
        ]
        return unusable + isolated(list(loaded.scans), batch.settings, computed, failed)

    def _row(self, loaded: LoadedBatch, place: int, outcome: Outcome) -> Row:
        hashed, scans = loaded.batch.pairs[place], loaded.scans[place]
        row = _identity(loaded.batch, hashed, outcome.setting)
        if self._keep:
            keep_scans(self._folder, hashed.inputs, scans)
            keep_result(self._folder, row["key"], outcome.result, self._keep)
        return row | outcome_columns(
            scans, outcome.result, loaded.seconds[place] / len(loaded.batch.settings)
        )


def lost_rows(batch: Batch, reason: str, status: str) -> list[Row]:
    """The rows of a batch whose workers ended before they could say anything."""
    now = datetime.now(UTC)
    common = _provenance() | {"batch": batch.name, "batch_runs": batch.num_runs, "started": now}
    failure = {"status": status, "message": reason}
    return [_identity(batch, pair, setting) | failure | common for pair, setting in batch.runs()]


def _identity(batch: Batch, hashed: HashedPair, setting: Setting) -> Row:
    pair, config = hashed.pair, setting.config
    return {
        "key": run_key(hashed, setting),
        "data": pair.data,
        "pair": pair.name,
        "inputs": hashed.inputs,
        "condition": pair.condition,
        "detector": config.detector,
        "max_components": config.max_components,
        "seed": config.seed,
        "repetition": setting.repetition,
        "axes": canonical_json(setting.axes),
        "configuration": setting.configuration,
        "attempt": batch.attempt(hashed, setting),
        "finished": datetime.now(UTC),
    }


def _failure(error: Exception) -> Row:
    told = str(error) if isinstance(error, NoveltyError) else f"{type(error).__name__}: {error}"
    return {"status": status_of(error), "message": told}


@cache
def _provenance() -> Row:
    return {
        "code": code_version(),
        "versions": canonical_json(versions()),
        "machine": canonical_json(machine()),
        "worker": f"{socket.gethostname()}:{os.getpid()}",
    }


def _memory() -> Row:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return {"memory": psutil.Process().memory_info().rss, "peak_memory": peak}
