"""The whole of section 3: every experiment, its rows, its pictures, the page."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from novelty.reproduction.findings import Finding, find
from novelty.reproduction.methods import (
    ALONE,
    CLUSTERINGS,
    EMD,
    M3C2,
    OURS,
    POINTWISE,
    PRINTED,
    STEPS,
    Method,
)
from novelty.reproduction.rows import write_rows
from novelty.reproduction.scoring import Outcome, run_experiment
from novelty.reproduction.segmentation import Segmentations, segment_case
from novelty.reproduction.sensitivity import BOX_SIZE, VIEWPOINT, run_sensitivity
from novelty.reproduction.simplification import SimplificationExample, SimplificationRow, run_simplification
from novelty.reproduction.thresholds import Thresholds, find_thresholds


@dataclass(frozen=True)
class Extent:
    """How much is run.

    Attributes:
        repetitions: Pairs per case at most.
        maps: Maps of each sensitivity study at most.
        segmentations: Repetitions of the comparison with Lomenie's method.
        training: Repetitions of the ten cases on which U_T and U_R are found.
    """

    repetitions: int
    maps: int
    segmentations: int
    training: int


FULL = Extent(repetitions=10, maps=12, segmentations=10, training=4)
FAST = Extent(repetitions=2, maps=4, segmentations=1, training=1)


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Everything that was computed, to be written and drawn.

    Attributes:
        outcome: Scores, tests and examples of all experiments with pairs.
        segmentations: Those of section 3.4.
        simplification: The rows and the picture of Fig. 4.
        thresholds: U_T and U_R of section 3.2.
        findings: What agrees with the paper.
        seconds: Wall time of every experiment.
    """

    outcome: Outcome
    segmentations: Segmentations
    simplification: tuple[list[SimplificationRow], SimplificationExample]
    thresholds: Thresholds
    findings: list[Finding]
    seconds: dict[str, float]


def reproduce(extent: Extent = FULL, say: Callable[[str], None] = lambda _: None) -> Reproduction:
    """Run the experiments of section 3.

    Args:
        extent: How much is run.
        say: Is told what is done next.
    """
    outcome, segmentations, clock = Outcome(), Segmentations(), _Clock(say)
    # Sections 2.2 and 2.3, Fig. 4 and 5.
    with clock.stage("simplification"):
        simplification = run_simplification(outcome, extent.repetitions)
    # Section 3.2.
    with clock.stage("thresholds of structural matching"):
        thresholds = find_thresholds(extent.training)
    everything = (*PRINTED, thresholds.method, *STEPS, *ALONE, *OURS)
    tested = _tested(thresholds.method)
    score = partial(run_experiment, outcome=outcome, repetitions=extent.repetitions, tested=tested)
    with clock.stage("synthetic corridor"):
        score("ideal_corridor", everything)
    # Sections 3.3 and 3.4, Fig. 11, 13 and 14.
    with clock.stage("static platform and Loménie's method"):
        segment = partial(segment_case, found=segmentations, repetitions=extent.segmentations)
        others = (*CLUSTERINGS, *POINTWISE, *((M3C2,) if find_spec("py4dgeo") else ()))
        score("static_platform", (*everything, *others), also=segment)
    # Section 3.5, Table 2, Fig. 12 and 15.
    with clock.stage("mobile platform"):
        score("mobile_platform", everything)
    # Section 3.6, Fig. 16 to 18.
    for name in (BOX_SIZE, VIEWPOINT):
        with clock.stage(f"sensitivity to {name.replace('_', ' ')}"):
            run_sensitivity(name, (*PRINTED, thresholds.method), outcome, extent.maps)
    # Section 4.
    with clock.stage("removal"):
        score("removal", everything, exchanged=True)
    findings = find(outcome.rows, segmentations.rows, thresholds)
    return Reproduction(outcome, segmentations, simplification, thresholds, findings, clock.seconds)


def _tested(calibrated: Method) -> tuple[tuple[Method, Method], ...]:
    """The pairs of methods that are told apart by McNemar's test."""
    return (PRINTED, (EMD, calibrated), (OURS[0], OURS[-1]))


def write_files(folder: Path, reproduction: Reproduction) -> None:
    """Write the rows of every kind as CSV and Parquet."""
    write_rows(folder, "rows", reproduction.outcome.rows)
    write_rows(folder, "mcnemar", reproduction.outcome.tests)
    write_rows(folder, "segmentation", reproduction.segmentations.rows)
    write_rows(folder, "simplification", reproduction.simplification[0])
    write_rows(folder, "thresholds", reproduction.thresholds.rows)
    write_rows(folder, "findings", reproduction.findings)


class _Clock:
    """Wall seconds per stage, each announced when it begins."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside."""
        self._say(name)
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start
