"""Reading scans and manifests of scan pairs, writing results."""

from novelty.io.atomic import replacing, write_json, write_text
from novelty.io.manifest import FailedPair, PairEntry, load_pairs, read_entries, read_pairs
from novelty.io.open3d_library import load_open3d
from novelty.io.ply import write_ply
from novelty.io.reading import READERS, read_scan

__all__ = [
    "READERS",
    "FailedPair",
    "PairEntry",
    "load_open3d",
    "load_pairs",
    "read_entries",
    "read_pairs",
    "read_scan",
    "replacing",
    "write_json",
    "write_ply",
    "write_text",
]
