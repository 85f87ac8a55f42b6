"""The paper's experimental section in our numbers: every experiment, table and figure, beside what was printed."""

from novelty.reproduction.drawing import matplotlib_figure
from novelty.reproduction.findings import Finding, Verdict
from novelty.reproduction.page import write_page
from novelty.reproduction.rows import Row, write_rows
from novelty.reproduction.run import FAST, FULL, Extent, Reproduction, reproduce, write_files

__all__ = [
    "FAST",
    "FULL",
    "Extent",
    "Finding",
    "Reproduction",
    "Row",
    "Verdict",
    "matplotlib_figure",
    "reproduce",
    "write_files",
    "write_page",
    "write_rows",
]
