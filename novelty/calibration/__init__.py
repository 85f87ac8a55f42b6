"""The parameters of a detector, chosen on labelled pairs, and what that gains on pairs it has not seen."""

from novelty.calibration.crossvalidation import Calibration, calibrate
from novelty.calibration.fitted import FittedPair, fit_pair, kappa
from novelty.calibration.grids import GRIDS
from novelty.calibration.thresholds import (
    NODE_THRESHOLDS,
    Pairings,
    joint_histogram,
    least_error_thresholds,
    pairings_of,
)

__all__ = [
    "GRIDS",
    "NODE_THRESHOLDS",
    "Calibration",
    "FittedPair",
    "Pairings",
    "calibrate",
    "fit_pair",
    "joint_histogram",
    "kappa",
    "least_error_thresholds",
    "pairings_of",
]
