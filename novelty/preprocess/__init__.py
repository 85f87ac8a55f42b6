"""Preprocessing (section 2.2): what of a scan is examined, and its cells."""

from novelty.preprocess.missing import check_scan
from novelty.preprocess.prepare import prepare, prepare_pairs
from novelty.preprocess.prepared import PreparedPairs, PreparedScans
from novelty.preprocess.settings import Preprocess
from novelty.preprocess.units import metres_per

__all__ = [
    "PreparedPairs",
    "PreparedScans",
    "Preprocess",
    "check_scan",
    "metres_per",
    "prepare",
    "prepare_pairs",
]
