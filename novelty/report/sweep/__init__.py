"""The report of a sweep: one page, tables and figures, made from the rows alone."""

from novelty.report.sweep.page import write_sweep_page
from novelty.report.sweep.runs import SweepRuns

__all__ = ["SweepRuns", "write_sweep_page"]
