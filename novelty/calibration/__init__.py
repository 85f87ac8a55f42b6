"""The parameters of a detector, chosen on labelled pairs, and what that gains on pairs it has not seen."""

from novelty.calibration.crossvalidation import Calibration, calibrate
from novelty.calibration.fitted import FittedPair, fit_pair, kappa
from novelty.calibration.grids import GRIDS
from novelty.calibration.thresholds import Pairings, least_error_thresholds, pairings_of

__all__ = [
    "GRIDS",
    "Calibration",
    "FittedPair",
    "Pairings",
    "calibrate",
    "fit_pair",
    "kappa",
    "least_error_thresholds",
    "pairings_of",
]
