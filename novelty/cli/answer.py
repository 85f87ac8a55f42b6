"""An answer on the terminal: first whether anything changed, then what, then how the time was spent."""

from __future__ import annotations

from collections.abc import Mapping

from rich.markup import escape
from rich.table import Table

from novelty.cli.scoring import cells, score_table, scored_pair
from novelty.cli.terminal import out, plain_table
from novelty.evaluation import LabelledScores
from novelty.report.answer import evidence, headline, notes, unseen
from novelty.report.tables import Table as ReportTable
from novelty.report.tables import object_table
from novelty.result import NoveltyResult

MAX_ROWS = 20
"""Objects listed at most; the report lists all."""


def show_answer(result: NoveltyResult, unit: str, scores: Mapping[str, LabelledScores]) -> None:
    """Print the headline, what it does not cover, the objects, the scores, the notes and the timings."""
    colour = "yellow" if result.changed else "green"
    out.print(f"[bold {colour}]{headline(result)}[/]")
    if evidence(result):
        out.print(evidence(result), style="dim")
    for line in unseen(result):
        out.print(line, style="yellow")
    objects = object_table(result, unit)
    if objects.rows:
        out.print(_as_rich(objects, leave_out=("components",)))
    if scores:
        table = score_table("ground truth")
        table.add_row("this pair", *cells(scored_pair("", result, scores).values))
        out.print(table)
    for note in notes(result):
        out.print(f"[yellow]note:[/] {escape(note)}")
    stages = ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in result.timings.items())
    out.print(f"time: {stages}", style="dim")


def _as_rich(table: ReportTable, leave_out: tuple[str, ...]) -> Table:
    kept = [place for place, column in enumerate(table.columns) if column.name not in leave_out]
    shown = plain_table()
    for place in kept:
        column = table.columns[place]
        wraps = column.name.startswith("centroid")  # map coordinates are long
        shown.add_column(
            escape(column.name), justify="right" if column.numeric else "left", no_wrap=not wraps
        )
    for row in table.rows[:MAX_ROWS]:
        shown.add_row(*(escape(row.cells[place]) for place in kept))
    if len(table.rows) > MAX_ROWS:
        shown.caption = f"and {len(table.rows) - MAX_ROWS} smaller ones"
    return shown
