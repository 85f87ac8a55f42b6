"""Sweeps: thousands of scan pairs under grids of configurations, batched, resumable, kept as rows."""

from novelty.sweep.folder import SweepFolder
from novelty.sweep.rows import COLUMNS, SCHEMA
from novelty.sweep.store import read_rows

__all__ = ["COLUMNS", "SCHEMA", "SweepFolder", "read_rows"]
