"""What is handed to people: the page, the record of a run, and the scans with their labels."""

from novelty.report.page import Run, write_report

__all__ = ["Run", "write_report"]
