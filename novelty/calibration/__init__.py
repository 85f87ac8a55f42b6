"""The parameters of a detector, chosen on labelled pairs, and what that gains on pairs it has not seen."""

from novelty.calibration.crossvalidation import Calibration, calibrate
from novelty.calibration.fitted import FittedPair, fit_pair, kappa
from novelty.calibration.grids import GRIDS
from novelty.calibration.pairings import Pairings, pairings_of
from novelty.calibration.thresholds import ARC_STEP, NODE_STEP, LeastError, least_error_thresholds

__all__ = [
    "ARC_STEP",
    "GRIDS",
    "NODE_STEP",
    "Calibration",
    "FittedPair",
    "LeastError",
    "Pairings",
    "calibrate",
    "fit_pair",
    "kappa",
    "least_error_thresholds",
    "pairings_of",
]
