"""What is handed to people: the page, the record of a run, and the scans with their labels."""

from novelty.report.answer import evidence, headline, notes, unseen
from novelty.report.outputs import check_folder, make_folder, write_labelled_scan, write_outputs
from novelty.report.page import write_report
from novelty.report.record import result_record
from novelty.report.run import Run

__all__ = [
    "Run",
    "check_folder",
    "evidence",
    "headline",
    "make_folder",
    "notes",
    "result_record",
    "unseen",
    "write_labelled_scan",
    "write_outputs",
    "write_report",
]
