"""The pairs of a batch, read and preprocessed; this much is done for the next batch while one is fitted."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from novelty.preprocess import check_scan
from novelty.scan import ScanPair
from novelty.sweep.batch import Batch
from novelty.sweep.compute import Prepared
from novelty.sweep.settings import Setting


@dataclass(frozen=True, eq=False)
class LoadedBatch:
    """What could be read of a batch.

    Attributes:
        batch: The batch.
        scans: The usable pairs, by their place in the batch.
        seconds: How long each took to read or to simulate.
        failures: Why the others are not usable, by their place.
        prepared: All usable pairs, preprocessed; None where there are none, or where that did not succeed: each is
            then tried on its own.
    """

    batch: Batch
    scans: Mapping[int, ScanPair]
    seconds: Mapping[int, float]
    failures: Mapping[int, Exception]
    prepared: Prepared | None

    def prepare(self, places: Sequence[int], settings: Sequence[Setting]) -> Prepared:
        """The pairs at these places prepared for these settings."""
        if self.prepared is not None and len(places) == len(self.scans) and settings == self.batch.settings:
            return self.prepared
        return Prepared.of([self.scans[place] for place in places], settings, self.batch.unit)


def load(batch: Batch) -> LoadedBatch:
    """Read and preprocess the pairs of a batch; one that cannot be used is told from the others, never raised."""
    scans: dict[int, ScanPair] = {}
    seconds: dict[int, float] = {}
    failures: dict[int, Exception] = {}
    for place, hashed in enumerate(batch.pairs):
        start = time.perf_counter()
        try:
            scans[place] = _usable(hashed.pair.load())
        except Exception as error:
            failures[place] = error
        seconds[place] = time.perf_counter() - start
    try:
        prepared = Prepared.of(list(scans.values()), batch.settings, batch.unit) if scans else None
    except Exception:
        prepared = None
    return LoadedBatch(batch, scans, seconds, failures, prepared)


def _usable(pair: ScanPair) -> ScanPair:
    check_scan(pair.reference)
    check_scan(pair.current)
    return pair
