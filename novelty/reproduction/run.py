"""The whole of section 3: every experiment, its rows, its pictures, the page."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from novelty.reproduction.findings import Finding, find
from novelty.reproduction.methods import ALONE, CLUSTERINGS, OURS, POINTWISE, PRINTED, STEPS
from novelty.reproduction.rows import write_rows
from novelty.reproduction.scoring import Outcome, run_experiment
from novelty.reproduction.segmentation import Segmentations, run_segmentation
from novelty.reproduction.sensitivity import BOX_SIZE, VIEWPOINT, run_sensitivity
from novelty.reproduction.simplification import SimplificationExample, SimplificationRow, run_simplification


@dataclass(frozen=True)
class Extent:
    """How much is run.

    Attributes:
        repetitions: Pairs per case at most.
        maps: Maps of each sensitivity study at most.
        segmentations: Repetitions of the comparison with Lomenie's method.
    """

    repetitions: int
    maps: int
    segmentations: int


FULL = Extent(repetitions=10, maps=12, segmentations=10)
FAST = Extent(repetitions=2, maps=4, segmentations=1)


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Everything that was computed, to be written and drawn.

    Attributes:
        outcome: Scores, tests and examples of all experiments with pairs.
        segmentations: Those of section 3.4.
        simplification: The rows and the picture of Fig. 4.
        findings: What agrees with the paper.
        seconds: Wall time of every experiment.
    """

    outcome: Outcome
    segmentations: Segmentations
    simplification: tuple[list[SimplificationRow], SimplificationExample]
    findings: list[Finding]
    seconds: dict[str, float]


def reproduce(extent: Extent = FULL, say: Callable[[str], None] = lambda _: None) -> Reproduction:
    """Run the experiments of section 3.

    Args:
        extent: How much is run.
        say: Is told what is done next.
    """
    outcome, seconds = Outcome(), {}
    everything = (*PRINTED, *STEPS, *ALONE, *OURS)
    few = {"repetitions": extent.repetitions, "tested": PRINTED}
    steps: dict[str, Callable[[], object]] = {
        "simplification": lambda: run_simplification(outcome, extent.repetitions),
        "ideal_corridor": lambda: run_experiment("ideal_corridor", everything, outcome, **few),
        "static_platform": lambda: run_experiment(
            "static_platform", (*everything, *CLUSTERINGS, *POINTWISE), outcome, **few
        ),
        "segmentation": lambda: run_segmentation(outcome, extent.segmentations),
        "mobile_platform": lambda: run_experiment("mobile_platform", everything, outcome, **few),
        BOX_SIZE: lambda: run_sensitivity(BOX_SIZE, outcome, extent.maps),
        VIEWPOINT: lambda: run_sensitivity(VIEWPOINT, outcome, extent.maps),
        "removal": lambda: run_experiment("removal", everything, outcome, exchanged=True, **few),
    }
    made = {}
    for name, step in steps.items():
        say(name.replace("_", " "))
        start = time.perf_counter()
        made[name] = step()
        seconds[name] = time.perf_counter() - start
    segmentations, simplification = made["segmentation"], made["simplification"]
    findings = find(outcome.rows, segmentations.rows)
    return Reproduction(outcome, segmentations, simplification, findings, seconds)


def write_files(folder: Path, reproduction: Reproduction) -> None:
    """Write the rows of every kind as CSV and Parquet."""
    write_rows(folder, "rows", reproduction.outcome.rows)
    write_rows(folder, "mcnemar", reproduction.outcome.tests)
    write_rows(folder, "segmentation", reproduction.segmentations.rows)
    write_rows(folder, "simplification", reproduction.simplification[0])
    write_rows(folder, "findings", reproduction.findings)
