"""How many pairs per second a detector compares, scans prepared and mixtures given: the clock behind table 6."""

from __future__ import annotations

import multiprocessing
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from threading import Barrier

import torch

from gmmtorch import GaussianMixtures
from novelty import Config, ScanPair
from novelty.detectors import Detector
from novelty.fitting import FitPlan, Models
from novelty.preprocess import PreparedPairs, prepare_pairs

K_MAX = 16
CALLS = 15
"""Timed calls after two to warm up; the median counts."""


@dataclass(frozen=True, eq=False)
class Comparing:
    """A batch of pairs that is ready to be compared by a detector."""

    detector: Detector
    batch: PreparedPairs
    models: Models

    @classmethod
    def of(cls, name: str, pairs: list[ScanPair]) -> Comparing:
        """Prepare the scans and fit their mixtures."""
        config = Config(detector=name)
        detector = config.chosen_detector
        batch = prepare_pairs(pairs, config.preprocess, config.unit)
        return cls(detector, batch, detector.fit(batch, FitPlan(config.fit, K_MAX, config.seed)))

    @property
    def mean_components(self) -> float:
        """Components per mixture; more than K_max with those for what the other scan does not explain."""
        fitted: list[GaussianMixtures] = [self.models.reference.mixtures, self.models.current.mixtures]
        return float(torch.cat([mixtures.num_components for mixtures in fitted]).double().mean())

    def seconds(self) -> float:
        """Median seconds per pair of this process."""
        taken = []
        for _ in range(2 + CALLS):
            start = time.perf_counter()
            self.detector.compare(self.batch, self.models)
            taken.append(time.perf_counter() - start)
        return statistics.median(taken[2:]) / len(self.batch)

    def seconds_with(self, workers: int) -> float:
        """Seconds per pair where so many processes of one thread each compare at the same time, as a sweep's do."""
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(workers, context, initializer=torch.set_num_threads, initargs=(1,))
        with context.Manager() as manager, pool:
            start = manager.Barrier(workers)  # until every worker has its batch
            begun = [pool.submit(_seconds, self, start) for _ in range(workers)]
            return 1 / sum(1 / future.result() for future in begun)


def _seconds(comparing: Comparing, start: Barrier) -> float:
    start.wait()
    return comparing.seconds()
