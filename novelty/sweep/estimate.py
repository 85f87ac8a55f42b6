"""What a batch will cost, from its points: the model behind the size of batches and the figures of `--dry-run`.

The constants were measured on one core of a two-core Xeon with simulated rooms; while a sweep runs, the time left
follows from the pairs that are done, not from here.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from novelty.config import Config
from novelty.errors import NoveltyError
from novelty.io import PairEntry
from novelty.sweep.settings import Setting
from novelty.sweep.sources import SweepPair

PREPROCESS, REGISTER, RUN = 5.0e-6, 0.8e-6, 2.5e-6
"""Seconds per point of a pair: of each preprocessing, each registration, and each run's comparison and labels."""

FIT = 1.0e-8
"""Seconds per point, per square of K_max, of each fit."""

SOURCE = (
    f"per point {PREPROCESS * 1e6:.2g} us for each preprocessing, {FIT * 1e6:.2g} us x K_max^2 for each fit, "
    f"{RUN * 1e6:.2g} us for each run, on one core."
)

RESIDENT = 600e6
"""Bytes of a process that has done nothing yet: Python, torch, Open3D."""

BYTES_PER_POINT, BYTES_PER_POINT_AND_COMPONENT = 700, 40
"""Bytes per point of a pair that is prepared, the one read ahead included, and of its labels per component."""

BYTES_PER_FILE_POINT = 16
"""Bytes of a point in a file, until one has been read."""


@dataclass(frozen=True)
class Cost:
    """Seconds on one core, and bytes."""

    seconds: float
    memory: float


class CostModel:
    """Costs of pairs under the settings of a sweep.

    One pair of every entry of `data` is read or simulated to learn how many points there are to a byte.
    """

    def __init__(self, pairs: Iterable[SweepPair]) -> None:
        """Read the first usable pair of every entry."""
        self._points: dict[str, float] = {}
        self._per_byte: dict[str, float] = {}
        for pair in pairs:
            if pair.data not in self._points:
                self._probe(pair)

    def points(self, pair: SweepPair) -> float:
        """Points of both scans of a pair, about."""
        if isinstance(pair.source, PairEntry):
            return _bytes(pair.source) * self._per_byte.get(pair.data, 1 / BYTES_PER_FILE_POINT)
        return self._points.get(pair.data, 0.0)

    def of(self, points: float, settings: Sequence[Setting]) -> Cost:
        """Cost of pairs with so many points in all, in one batch under these settings."""
        configs = [setting.config for setting in settings]
        orders = max(config.max_components for config in configs)
        seconds = (
            PREPROCESS * len({_preprocessing(c) for c in configs})
            + REGISTER * len({(_preprocessing(c), c.registration) for c in configs})
            + FIT * sum(order**2 for order, *_ in {_fitting(c) for c in configs})
            + RUN * len(configs)
        )
        memory = RESIDENT + points * (BYTES_PER_POINT + BYTES_PER_POINT_AND_COMPONENT * orders)
        return Cost(points * seconds, memory)

    def _probe(self, pair: SweepPair) -> None:
        try:
            scans = pair.load()
        except (NoveltyError, OSError):
            return
        points = scans.reference.num_points + scans.current.num_points
        self._points[pair.data] = points
        if isinstance(pair.source, PairEntry):
            self._per_byte[pair.data] = points / max(_bytes(pair.source), 1)


def _preprocessing(config: Config) -> Hashable:
    return (config.preprocess, config.unit)


def _fitting(config: Config) -> tuple[int, Hashable, Hashable, Hashable, int]:
    return (config.max_components, _preprocessing(config), config.registration, config.fit, config.seed)


def _bytes(entry: PairEntry) -> float:
    return float(sum(_size(file) for file in entry.files()))


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0
