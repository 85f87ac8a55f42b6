"""Several methods on the same pairs: what they have in common is computed once, for all pairs in one batch."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from gmmtorch import FitResult, GaussianMixtures
from novelty.config import Config
from novelty.detectors import PointNovelty
from novelty.fitting import FitPlan, Models, fit_scans
from novelty.pipeline import segment_current
from novelty.preprocess import PreparedPairs, prepare_pairs
from novelty.registration import register
from novelty.reproduction.methods import Method
from novelty.scan import ScanPair


@dataclass(frozen=True, eq=False)
class Answer:
    """What one method says of the current scans of P pairs.

    Attributes:
        labels: For each pair, which points are novel, bool (N_p,).
        components: For each pair, the most probable component of every point, int64 (N_p,); -1 none.
        mixtures: P mixtures of the current scans; of no components for a method without.
        novel: Novel components, bool (P, K); all False for a method that compares points.
        distance: Between the two mixtures (P,), eq. 8, in the method's ground distance; NaN where there is none.
        seconds: Per pair, by stage; a stage that methods share counts for each of them.
    """

    labels: tuple[NDArray[np.bool_], ...]
    components: tuple[NDArray[np.int64], ...]
    mixtures: GaussianMixtures
    novel: torch.Tensor
    distance: torch.Tensor
    seconds: Mapping[str, float]


class _Stage(NamedTuple):
    """What a stage made, and how long it took, s."""

    value: Any
    seconds: float


class Workbench:
    """P pairs, and the stages that have been computed for them."""

    def __init__(self, pairs: Sequence[ScanPair]) -> None:
        self.pairs = tuple(pairs)
        self._stages: dict[Hashable, _Stage] = {}

    def prepared(self, config: Config) -> PreparedPairs:
        """The pairs after preprocessing."""
        return self._prepared(config).value

    def answer(self, method: Method, settings: Mapping[str, Any]) -> Answer:
        """Compare all pairs by a method, under an analysis' settings (keys of `Config`)."""
        config = method.config.replace(**settings)
        plan = FitPlan(config.fit, config.max_components, config.seed)

        def fit() -> Models:
            return config.chosen_detector.fit(self._aligned(config), plan)

        shared = method.mixtures or method.key
        key = ("models", shared, config.preprocess, config.registration, config.max_components)
        return self._answer(config, self._once(key, fit))

    def answers_by_order(
        self, method: Method, settings: Mapping[str, Any], orders: Sequence[int]
    ) -> dict[int, Answer]:
        """Compare all pairs by mixtures of exactly K components, for several K, every scan on its own.

        The mixtures are those that one search of the order meets on its way down from the largest K; where it skips an
        order, because a component was dropped, those of the next lower one stand in.
        """
        config = method.config.replace(**settings).replace(max_components=max(orders))
        plan = FitPlan(config.fit, config.max_components, config.seed)

        def fit() -> FitResult:
            batch = self._aligned(config)
            return fit_scans([batch.reference, batch.current], plan, return_path=True)

        key = ("path", config.fit, config.preprocess, config.registration, config.max_components)
        path = self._once(key, fit)
        return {
            order: self._answer(config, _Stage(_models_of_order(path.value, order), path.seconds))
            for order in orders
        }

    def _answer(self, config: Config, models: _Stage) -> Answer:
        batch, registered = self._prepared(config), self._registered(config)
        aligned = self._aligned(config)
        start = time.perf_counter()
        comparison = config.chosen_detector.compare(aligned, models.value)
        compared = time.perf_counter()
        points = segment_current(aligned, models.value, comparison.added, config)
        stages = {
            "preprocess": batch.seconds,
            "register": registered.seconds if config.registration.method != "none" else 0.0,
            "fit": models.seconds,
            "compare": compared - start,
            "segment": time.perf_counter() - compared,
        }
        novelty, mixtures = comparison.added, models.value.current.mixtures
        return Answer(
            labels=self._scattered(batch.value, points.labels, False),
            components=self._scattered(batch.value, points.components, -1),
            mixtures=mixtures,
            distance=comparison.distance,
            novel=torch.zeros_like(mixtures.mask) if isinstance(novelty, PointNovelty) else novelty.novel,
            seconds={stage: seconds / len(self.pairs) for stage, seconds in stages.items()},
        )

    def _prepared(self, config: Config) -> _Stage:
        return self._once(config.preprocess, lambda: prepare_pairs(self.pairs, config.preprocess))

    def _registered(self, config: Config) -> _Stage:
        batch = self.prepared(config)
        return self._once(
            (config.preprocess, config.registration), lambda: register(batch, config.registration)
        )

    def _aligned(self, config: Config) -> PreparedPairs:
        registered = self._registered(config).value
        key = ("aligned", config.preprocess, config.registration)
        return self._once(
            key, lambda: self.prepared(config).aligned(registered.transforms, registered.residual)
        ).value

    def _once(self, key: Hashable, make: Callable[[], Any]) -> _Stage:
        if key not in self._stages:
            start = time.perf_counter()
            value = make()
            self._stages[key] = _Stage(value, time.perf_counter() - start)
        return self._stages[key]

    def _scattered(
        self, batch: PreparedPairs, values: torch.Tensor, missing: Any
    ) -> tuple[NDArray[Any], ...]:
        """Values of the examined points as values of all points."""
        found = []
        parts = zip(self.pairs, batch.current.kept, batch.current.points.split(values), strict=True)
        for pair, kept, part in parts:
            whole = np.full(pair.current.num_points, missing, dtype=part.numpy().dtype)
            whole[kept] = part.numpy()
            found.append(whole)
        return tuple(found)


def _models_of_order(fits: FitResult, order: int) -> Models:
    """Both scans' mixtures of K components, from fits of all references and then all current scans."""
    assert fits.path is not None
    counts = torch.stack([mixtures.num_components for mixtures in fits.path], 1)  # (2 P, K_max)
    reached = torch.arange(1, counts.shape[1] + 1)
    best = torch.where((counts > 0) & (reached <= order), reached, 0).amax(1).clamp_min(1).tolist()
    mixtures = GaussianMixtures.from_list([fits.path[k - 1][b] for b, k in enumerate(best)])
    fixed, pairs = replace(fits, mixtures=mixtures, path=None), len(mixtures) // 2
    return Models(reference=fixed.select(range(pairs)), current=fixed.select(range(pairs, 2 * pairs)))
