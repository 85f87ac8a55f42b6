"""Section 3.4: the mixtures' segmentation beside Lomenie's fuzzy partition, in clusters, seconds, and the door."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from gmmtorch import GaussianMixtures, PointClouds
from novelty.baselines.fuzzy_clustering import FuzzyPartitions, alpha_cut, fit_fuzzy_partitions
from novelty.config import Config
from novelty.evaluation import evaluate_labels
from novelty.fitting import FitPlan, fit_scans
from novelty.preprocess import PreparedScans
from novelty.preprocess.simplify import Scale, simplify
from novelty.reproduction.scoring import Outcome, SimulatedCase, best_choice, simulated
from novelty.scan import CHANGED, SEEN_ONCE
from novelty.simulation.experiments import load_experiment

T = TypeVar("T")

ALPHA_CUT = 0.2
"""S: a point belongs to a cluster when its membership is greater (section 3.4)."""

FORCED = 9
"""Clusters that Lomenie's method is allowed, and forced to make."""

AUTOMATIC, NINE, MIXTURE_9, MIXTURE_20 = "fuzzy_automatic", "fuzzy_9", "mixture_9", "mixture_20"
TITLES = {
    AUTOMATIC: "Loménie, 1 to 9 clusters",
    NINE: "Loménie, forced to 9",
    MIXTURE_9: "mixture, K_max = 9",
    MIXTURE_20: "mixture, K_max = 20",
}
"""The segmentations by their key, in the order of Fig. 13 and 14."""


@dataclass(frozen=True)
class SegmentationRow:
    """How one scan was segmented.

    Attributes:
        points: Examined points of the scan.
        clusters: How many there are.
        without_cluster: Points that belong to none.
        kappa: Of the points in the clusters that are best called novel, knowing the truth: what can be reached.
        seconds: From the examined points to the clusters.
    """

    case: str
    repetition: int
    method: str
    points: int
    clusters: int
    without_cluster: int
    kappa: float
    seconds: float


@dataclass(frozen=True, eq=False)
class Segmentation:
    """How one scan was segmented, to be drawn: points (N, 3) m, clusters (N,), whether they have changed (N,)."""

    case: str
    method: str
    points: NDArray[np.float64]
    clusters: NDArray[np.int64]
    changed: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Segmentations:
    """All rows, and the first repetition of every case to be drawn."""

    rows: list[SegmentationRow]
    examples: list[Segmentation]


def run_segmentation(outcome: Outcome, repetitions: int) -> Segmentations:
    """Segment the current scans of the static platform by every method."""
    found = Segmentations([], [])
    experiment = load_experiment("static_platform")
    for batch in simulated(
        replace(experiment, repetitions=min(repetitions, experiment.repetitions)), outcome
    ):
        for method, labels, clusters, seconds in _segmented(batch):
            _record(found, batch, method, labels, clusters, seconds)
    return found


def _segmented(batch: SimulatedCase) -> Iterator[tuple[str, torch.Tensor, list[int], float]]:
    """For every method: the cluster of every point, the number of clusters (P,), seconds per scan."""
    config = Config.preset("paper")
    scans = batch.bench.prepared(config).current
    count = len(scans)
    partitions, seconds = _timed(lambda: fit_fuzzy_partitions(scans.points, FORCED))
    for method, orders in ((AUTOMATIC, partitions.best()), (NINE, [FORCED] * count)):
        yield method, _cut(partitions, orders, scans.points), orders, seconds / count
    for method, most in ((MIXTURE_9, FORCED), (MIXTURE_20, 20)):
        mixtures, seconds = _timed(partial(_mixtures, scans, config.replace(max_components=most)))
        yield method, mixtures.assign(scans.points), mixtures.num_components.tolist(), seconds / count


def _mixtures(scans: PreparedScans, config: Config) -> GaussianMixtures:
    """Simplification and fit, both of which are counted."""
    rule = config.preprocess
    cells = simplify(scans.points, Scale("or", rule.max_cell_size, rule.max_surface_variation)).cells
    plan = FitPlan(config.fit, config.max_components, config.seed)
    return fit_scans([replace(scans, cells=cells)], plan).mixtures


def _cut(partitions: FuzzyPartitions, orders: list[int], points: PointClouds) -> torch.Tensor:
    clusters: GaussianMixtures = partitions.taken(orders)
    return alpha_cut(clusters.responsibilities(points), ALPHA_CUT)


def _timed(make: Callable[[], T]) -> tuple[T, float]:
    start = time.perf_counter()
    value = make()
    return value, time.perf_counter() - start


def _record(
    found: Segmentations,
    batch: SimulatedCase,
    method: str,
    labels: torch.Tensor,
    clusters: list[int],
    seconds: float,
) -> None:
    scans = batch.bench.prepared(Config.preset("paper")).current
    parts = zip(
        batch.members, batch.bench.pairs, scans.kept, scans.points.split(labels), clusters, strict=True
    )
    for member, pair, kept, part, count in parts:
        assert pair.current.labels is not None
        truth, own = pair.current.labels[kept], part.numpy()
        scores = evaluate_labels(truth, best_choice(own, truth == CHANGED, truth >= SEEN_ONCE)).scores
        without = int((own < 0).sum())
        found.rows.append(
            SegmentationRow(
                member.case.name, member.repetition, method, len(own), count, without, scores.kappa, seconds
            )
        )
        if member is batch.members[0]:
            points = pair.current.points[kept]
            found.examples.append(Segmentation(member.case.name, method, points, own, truth == CHANGED))
