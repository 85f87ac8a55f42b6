"""Section 3.4: the mixtures' segmentation beside Lomenie's fuzzy partition, in clusters, seconds, and the door."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
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
from novelty.reproduction.scoring import SimulatedCase, best_choice
from novelty.scan import CHANGED, SEEN_ONCE

T = TypeVar("T")

PAPER = Config.preset("paper")

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
        by_hypervolume: What another measure of validity would have chosen, the least fuzzy hypervolume; 0 where nothing
            was chosen.
        by_average_density: The same of the greatest average partition density.
        kappa: Of the points in the clusters that are best called novel, knowing the truth: what can be reached.
        seconds: From the examined points to the clusters.
    """

    case: str
    repetition: int
    method: str
    points: int
    clusters: int
    without_cluster: int
    by_hypervolume: int
    by_average_density: int
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

    rows: list[SegmentationRow] = field(default_factory=list)
    examples: list[Segmentation] = field(default_factory=list)


def segment_case(batch: SimulatedCase, found: Segmentations, repetitions: int) -> None:
    """Segment the current scans of one case by every method.

    Args:
        batch: The pairs of the case.
        found: Takes what comes out.
        repetitions: Scans of the case at most.
    """
    prepared = batch.bench.prepared(PAPER).current
    scans = prepared.select(range(min(repetitions, len(prepared))))
    for answer in _segmented(scans):
        _record(found, batch, scans, answer)


@dataclass(frozen=True, eq=False)
class _Answer:
    """What one method says of P scans: the cluster of every point (N,), how many (P,), seconds per scan.

    `others` has what the other two measures of validity would have chosen (P,) each, if anything was chosen.
    """

    method: str
    labels: torch.Tensor
    clusters: list[int]
    seconds: float
    others: tuple[list[int], list[int]] | None = None


def _segmented(scans: PreparedScans) -> Iterator[_Answer]:
    count = len(scans)
    partitions, seconds = _timed(lambda: fit_fuzzy_partitions(scans.points, FORCED))
    others = partitions.best("hypervolume"), partitions.best("average_density")
    for method, orders, told in ((AUTOMATIC, partitions.best(), others), (NINE, [FORCED] * count, None)):
        yield _Answer(method, _cut(partitions, orders, scans.points), orders, seconds / count, told)
    for method, most in ((MIXTURE_9, FORCED), (MIXTURE_20, 20)):
        mixtures, seconds = _timed(partial(_mixtures, scans, PAPER.replace(max_components=most)))
        orders = mixtures.num_components.tolist()
        yield _Answer(method, mixtures.assign(scans.points), orders, seconds / count)


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


def _record(found: Segmentations, batch: SimulatedCase, scans: PreparedScans, answer: _Answer) -> None:
    labels, none = scans.points.split(answer.labels), [0] * len(scans)
    others = zip(*(answer.others or (none, none)), strict=True)
    parts = zip(batch.members, batch.bench.pairs, scans.kept, labels, answer.clusters, others, strict=False)
    for member, pair, kept, part, count, (by_hypervolume, by_average_density) in parts:
        assert pair.current.labels is not None
        truth, own = pair.current.labels[kept], part.numpy()
        scores = evaluate_labels(truth, best_choice(own, truth == CHANGED, truth >= SEEN_ONCE)).scores
        without = int((own < 0).sum())
        found.rows.append(
            SegmentationRow(
                member.case.name,
                member.repetition,
                answer.method,
                len(own),
                count,
                without,
                by_hypervolume,
                by_average_density,
                scores.kappa,
                answer.seconds,
            )
        )
        if member is batch.members[0]:
            points = pair.current.points[kept]
            found.examples.append(
                Segmentation(member.case.name, answer.method, points, own, truth == CHANGED)
            )
