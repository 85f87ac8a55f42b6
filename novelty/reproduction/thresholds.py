"""Section 3.2: U_T and U_R of structural matching by the least probability of error, on 40 labelled maps.

The maps have seeds below 100, which no table is made of. What is found is a second reading of structural matching:
everything as printed, with the thresholds that the printed procedure gives for these scans.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from novelty.calibration import (
    ARC_STEP,
    NODE_STEP,
    FittedPair,
    Pairings,
    fit_pair,
    least_error_thresholds,
    pairings_of,
)
from novelty.config import Config
from novelty.errors import InputError
from novelty.reproduction.methods import CALIBRATED, STRUCTURAL, Method
from novelty.simulation.experiments import Analysis, ExperimentPair, load_experiment

TRAINING = ("static_platform", "mobile_platform", "removal", "ideal_corridor")
"""Experiments whose scenes, sensors and changes the maps have: ten cases, each under its last analysis."""

TRAINING_SEED = 0
"""Of the first repetition."""

NO_LENGTH = 1e9
"""A length scale at which metres weigh nothing, so that eqs. 9 and 12 speak of shapes only, m."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ThresholdRow:
    """What the printed thresholds let pass of one labelled pair of maps; shares, NaN where there is no pairing.

    Attributes:
        valid_pairings: Components that hold the same unchanged place in both mixtures.
        near: Share of the valid pairings with d < U_T (eq. 9).
        alike: Share with a relative difference of shapes, omega of d_Sigma, up to U_R (eq. 12), over the valid pairings
            beside each.
        valid: Share of both, metres included: P(d < U_T, delta < U_R | v).
        invalid: The same of pairings that hold different places.
    """

    scene: str
    case: str
    seed: int
    valid_pairings: int
    near: float
    alike: float
    valid: float
    invalid: float

    @property
    def error(self) -> float:
        """P_err of the printed thresholds."""
        return (self.invalid + 1 - self.valid) / 2


@dataclass(frozen=True, eq=False)
class Thresholds:
    """U_T and U_R of least error, and the joint histograms that they come from.

    Attributes:
        rows: One per pair of maps.
        node: U_T.
        arc: U_R.
        error: P_err at these.
        valid: Joint histogram of d and delta of valid pairings (T, R), every pair of maps with the same weight.
        invalid: The same of invalid pairings.
        notes: Where other values err as little.
    """

    rows: list[ThresholdRow]
    node: float
    arc: float
    error: float
    valid: Array
    invalid: Array
    notes: tuple[str, ...] = ()

    @property
    def bins(self) -> tuple[Array, Array]:
        """Centres of the bins of d (T,) and of delta (R,)."""
        nodes, arcs = self.valid.shape
        return np.arange(0.5, nodes) * NODE_STEP, np.arange(0.5, arcs) * ARC_STEP

    @property
    def method(self) -> Method:
        """Structural matching as printed, but for these thresholds."""
        return replace(CALIBRATED, config=CALIBRATED.config.replace(**self._settings))

    @property
    def options(self) -> str:
        """What `novelty detect` is given to use them: the preset, and where it has others, these."""
        preset = "--preset paper_calibrated"
        if self.method == CALIBRATED:
            return preset
        return " ".join([preset, *(f"--set {key}={value:g}" for key, value in self._settings.items())])

    @property
    def _settings(self) -> dict[str, float]:
        return {
            "structural_matching.node_threshold": self.node,
            "structural_matching.arc_threshold": self.arc,
        }


def find_thresholds(repetitions: int) -> Thresholds:
    """Fit the labelled maps as printed and minimise the probability of error.

    Args:
        repetitions: Of each of the ten cases.
    """
    rows: list[ThresholdRow] = []
    pairings: list[Pairings] = []
    for member, analysis in _training(repetitions):
        config = STRUCTURAL.config.replace(**analysis.settings)
        try:
            fitted = fit_pair(member.simulate().scans, config)
        except InputError:  # no room for the change
            continue
        pairings.append(pairings_of(fitted, config.structural_matching))
        rows.append(_row(member, fitted, config, pairings[-1]))
    found = least_error_thresholds(pairings)
    return Thresholds(rows, found.node, found.arc, found.error, found.valid, found.invalid, found.notes)


def _training(repetitions: int) -> Iterator[tuple[ExperimentPair, Analysis]]:
    for name in TRAINING:
        experiment = replace(load_experiment(name), repetitions=repetitions, seed=TRAINING_SEED)
        for member in experiment.pairs():
            yield member, experiment.analyses[-1]


def _row(member: ExperimentPair, fitted: FittedPair, config: Config, pairings: Pairings) -> ThresholdRow:
    printed = config.structural_matching
    limits = (printed.node_threshold, printed.arc_threshold)
    shapes = pairings_of(fitted, replace(printed, length_scale=NO_LENGTH))
    return ThresholdRow(
        scene=member.case.setup.scene,
        case=member.case.name,
        seed=member.seed,
        valid_pairings=len(np.unique(pairings.valid[:, 0])),
        near=_share(pairings.valid[:, 0] < limits[0]),
        alike=_share(shapes.valid[:, 1] <= limits[1]),
        valid=_share(_within(pairings.valid, limits)),
        invalid=_share(_within(pairings.invalid, limits)),
    )


def _within(rows: Array, limits: tuple[float, float]) -> NDArray[np.bool_]:
    return (rows[:, 0] < limits[0]) & (rows[:, 1] <= limits[1])


def _share(held: NDArray[np.bool_]) -> float:
    return float(held.mean()) if len(held) else float("nan")
