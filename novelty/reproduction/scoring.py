"""Run an experiment: simulate its pairs, let every method answer, score the answers as section 3.1 does."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from gmmtorch import GaussianMixtures
from novelty.errors import InputError
from novelty.evaluation import ContingencyTable, evaluate, mcnemar, mcnemar_over_scans
from novelty.evaluation.metrics import kappa
from novelty.reproduction.methods import Method
from novelty.reproduction.rows import Row, scored_fields
from novelty.reproduction.workbench import Answer, Workbench
from novelty.scan import CHANGED, SEEN_ONCE, Scan, ScanPair
from novelty.simulation.experiments import Analysis, Case, Experiment, ExperimentPair, load_experiment

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Example:
    """What one method found in one scan, to be drawn: its mixture, the novel components (K,) and points (N,)."""

    experiment: str
    member: ExperimentPair
    analysis: str
    method: str
    scan: Scan
    mixture: GaussianMixtures
    novel: torch.Tensor
    labels: NDArray[np.bool_]


@dataclass(frozen=True)
class MethodTest:
    """McNemar's test of two methods on the same points, those of all repetitions of a case together.

    Attributes:
        first_only: Points that only the first method labels rightly.
        second_only: Points that only the second one does.
        p_value: Of all points, as if they were independent.
        scans: Repetitions.
        p_over_scans: With the points of one scan correlated, as they are.
    """

    experiment: str
    case: str
    analysis: str
    first: str
    second: str
    first_only: int
    second_only: int
    p_value: float
    scans: int
    p_over_scans: float


@dataclass
class Outcome:
    """Everything that the experiments leave behind.

    Attributes:
        rows: One per pair, analysis and method.
        tests: One per case, analysis and pair of methods that are told apart.
        examples: The first repetition of every case, by every method.
        left_out: Names of pairs for which the scene of their seed had no room.
        simulation_seconds: Of every pair.
    """

    rows: list[Row] = field(default_factory=list)
    tests: list[MethodTest] = field(default_factory=list)
    examples: list[Example] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    simulation_seconds: list[float] = field(default_factory=list)

    def examples_of(self, experiment: str, case: str, analysis: str, method: str) -> list[Example]:
        """Those that were kept of a case."""
        wanted = (experiment, case, analysis, method)
        return [
            e for e in self.examples if (e.experiment, e.member.case.name, e.analysis, e.method) == wanted
        ]


def run_experiment(
    name: str,
    methods: Sequence[Method],
    outcome: Outcome,
    *,
    repetitions: int | None = None,
    exchanged: bool = False,
    tested: Sequence[tuple[Method, Method]] = (),
    also: Callable[[SimulatedCase], None] = lambda _: None,
) -> None:
    """Score every method on every pair of an experiment, one batch per case.

    Args:
        name: Of the experiment.
        methods: What is compared, under each of the experiment's analyses.
        outcome: Takes what comes out.
        repetitions: Pairs per case; those of the experiment when None.
        exchanged: Whether the current scan takes the reference's place, so that what was removed is found as added.
        tested: Pairs of methods between which McNemar's test is made.
        also: What else is done with each batch.
    """
    experiment = shortened(load_experiment(name), repetitions)
    for batch in simulated(experiment, outcome, exchanged):
        for analysis in experiment.analyses:
            answers = {method.key: batch.bench.answer(method, analysis.settings) for method in methods}
            for key, answer in answers.items():
                outcome.rows += batch.rows(analysis, key, answer)
                outcome.examples.append(batch.example(analysis, key, answer))
            outcome.tests += [batch.test(analysis, answers, a.key, b.key) for a, b in tested]
        also(batch)


def shortened(experiment: Experiment, repetitions: int | None) -> Experiment:
    """The experiment with so many repetitions at most; as it is when None."""
    most = experiment.repetitions
    return replace(experiment, repetitions=most if repetitions is None else min(repetitions, most))


@dataclass(frozen=True, eq=False)
class SimulatedCase:
    """The pairs of one case, and the workbench that compares them."""

    experiment: str
    members: tuple[ExperimentPair, ...]
    bench: Workbench

    @property
    def case(self) -> Case:
        """The condition that the pairs share."""
        return self.members[0].case

    def rows(self, analysis: Analysis, method: str, answer: Answer, order: int = 0) -> list[Row]:
        """One row per pair."""
        return [self._row(index, analysis, method, answer, order) for index in range(len(self.members))]

    def example(self, analysis: Analysis, method: str, answer: Answer, index: int = 0) -> Example:
        """What the answer says of a pair."""
        scan = self.bench.pairs[index].current
        within = _area(scan, analysis.settings)
        part = Scan(
            scan.points[within], labels=None if scan.labels is None else scan.labels[within], name=scan.name
        )
        return Example(
            self.experiment,
            self.members[index],
            analysis.name,
            method,
            part,
            answer.mixtures[index],
            answer.novel[index],
            answer.labels[index][within],
        )

    def test(self, analysis: Analysis, answers: Mapping[str, Answer], first: str, second: str) -> MethodTest:
        """McNemar's test over the points of all pairs, and over the pairs."""
        judged = [_truth(pair.current, analysis.settings) for pair in self.bench.pairs]
        labels = [answers[key].labels for key in (first, second)]
        each = [mcnemar(truth, a, b, ignored) for (truth, ignored), a, b in zip(judged, *labels, strict=True)]
        truth, ignored = (np.concatenate(parts) for parts in zip(*judged, strict=True))
        pooled = [np.concatenate(parts) for parts in labels]
        found = mcnemar(truth, pooled[0], pooled[1], ignored)
        return MethodTest(
            self.experiment,
            self.case.name,
            analysis.name,
            first,
            second,
            found.first_only,
            found.second_only,
            found.p_value,
            len(each),
            mcnemar_over_scans(each),
        )

    def _row(self, index: int, analysis: Analysis, method: str, answer: Answer, order: int) -> Row:
        member, scan = self.members[index], self.bench.pairs[index].current
        truth, ignored = _truth(scan, analysis.settings)
        scores = evaluate(truth, answer.labels[index], ignore=ignored)
        return Row(
            experiment=self.experiment,
            case=member.case.name,
            repetition=member.repetition,
            seed=member.seed,
            varied=", ".join(f"{key}={value}" for key, value in member.case.varied.items()),
            analysis=analysis.name,
            method=method,
            order=order,
            components=int(answer.mixtures.num_components[index]),
            points=scan.num_points,
            changed_points=int((truth & ~ignored).sum()),
            attainable=evaluate(
                truth, best_choice(answer.components[index], truth, ignored), ignore=ignored
            ).kappa,
            distance=float(answer.distance[index]),
            **scored_fields(scores),
            preprocess=answer.seconds["preprocess"],
            register=answer.seconds["register"],
            fit=answer.seconds["fit"],
            compare=answer.seconds["compare"],
            segment=answer.seconds["segment"],
        )


def simulated(experiment: Experiment, outcome: Outcome, exchanged: bool = False) -> Iterator[SimulatedCase]:
    """The pairs of an experiment, case by case; pairs for which there is no room are left out and noted."""
    by_case: dict[str, list[ExperimentPair]] = {}
    for member in experiment.pairs():
        by_case.setdefault(member.case.name, []).append(member)
    for members in by_case.values():
        made = [(member, pair) for member in members if (pair := _simulate(member, outcome)) is not None]
        if made:
            pairs = [
                ScanPair(pair.current, pair.reference, pair.name) if exchanged else pair for _, pair in made
            ]
            yield SimulatedCase(experiment.name, tuple(member for member, _ in made), Workbench(pairs))


def _simulate(member: ExperimentPair, outcome: Outcome) -> ScanPair | None:
    start = time.perf_counter()
    try:
        pair = member.simulate().scans
    except InputError as error:
        _log.info("%s is left out: %s", member.name, error)
        outcome.left_out.append(member.name)
        return None
    outcome.simulation_seconds.append(time.perf_counter() - start)
    return pair


def _truth(scan: Scan, settings: Mapping[str, Any]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether each point has changed, and whether it is not scored (N,)."""
    assert scan.labels is not None
    return scan.labels == CHANGED, (scan.labels >= SEEN_ONCE) | ~_area(scan, settings)


def _area(scan: Scan, settings: Mapping[str, Any]) -> NDArray[np.bool_]:
    """The points that an analysis looks at, bool (N,)."""
    height = settings.get("preprocess.max_height")
    return np.ones(scan.num_points, dtype=bool) if height is None else scan.points[:, 2] <= height


def best_choice(
    components: NDArray[np.int64], changed: NDArray[np.bool_], ignored: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Whether each point is in one of the components that are best called novel, knowing the truth (N,).

    Kappa is a ratio of linear functions of the counts, so the best set holds the components with the largest shares of
    changed points, down to some share.

    Args:
        components: Of every point (N,), -1 none.
        changed: Whether each point has changed (N,).
        ignored: Points that are not scored (N,).
    """
    scored = (components >= 0) & ~ignored
    size = np.bincount(components[scored], minlength=int(components.max(initial=0)) + 1)
    hits = np.bincount(components[scored & changed], minlength=len(size))
    order = np.argsort(-hits / np.maximum(size, 1), kind="stable")
    found, called = np.cumsum(hits[order]), np.cumsum(size[order])
    novel, total = int((changed & ~ignored).sum()), int((~ignored).sum())
    tables = [
        ContingencyTable(int(a), novel - int(a), int(n - a), total - novel - int(n - a))
        for a, n in zip(found, called, strict=True)
    ]
    kappas = [kappa(table) for table in tables]
    if not hits.any():
        return np.zeros(len(components), dtype=bool)
    return np.isin(components, order[: int(np.nanargmax(kappas)) + 1])
