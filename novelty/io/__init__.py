"""Reading scans and manifests of scan pairs, writing results."""

from novelty.io.atomic import replacing, write_json, write_text
from novelty.io.manifest import FailedPair, load_pairs, read_entries, read_pairs
from novelty.io.open3d_library import load_open3d
from novelty.io.overwriting import refuse_overwriting
from novelty.io.pair_entry import PairEntry
from novelty.io.ply import write_ply
from novelty.io.poses import Poses
from novelty.io.reading import PART_READERS, READERS, read_scan
from novelty.io.sequence import read_sequence

__all__ = [
    "PART_READERS",
    "READERS",
    "FailedPair",
    "PairEntry",
    "Poses",
    "load_open3d",
    "load_pairs",
    "read_entries",
    "read_pairs",
    "read_scan",
    "read_sequence",
    "refuse_overwriting",
    "replacing",
    "write_json",
    "write_ply",
    "write_text",
]
