"""The report of a sweep: one page, tables and figures, made from the rows alone."""

from novelty.report.sweep.csv_file import write_sweep_csv
from novelty.report.sweep.latex import write_sweep_latex
from novelty.report.sweep.page import write_sweep_page
from novelty.report.sweep.plots import write_sweep_plots
from novelty.report.sweep.runs import SweepRuns

__all__ = ["SweepRuns", "write_sweep_csv", "write_sweep_latex", "write_sweep_page", "write_sweep_plots"]
