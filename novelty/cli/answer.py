"""An answer on the terminal: first whether anything changed, then what, then how the time was spent."""

from __future__ import annotations

from collections.abc import Mapping

from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

from novelty.cli.scoring import cells, score_table, scored_pair
from novelty.cli.terminal import out, plain_table
from novelty.evaluation import LabelledScores
from novelty.report.answer import evidence, headline, notes, unseen
from novelty.report.tables import Row, object_table
from novelty.report.tables import Table as ReportTable
from novelty.result import NoveltyResult

MAX_ROWS = 20
"""Objects listed at most; the report lists all."""

DISPENSABLE = ("score", "p-value", "centroid")
"""Beginnings of the names of columns that a narrow terminal does without, in this order; the report has them."""

UNLIMITED = 10_000
"""Characters; wider than any table."""


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
        _show_objects(objects)
    scored = scored_pair("", result, scores)
    if scored.any_defined:
        table = score_table("ground truth")
        table.add_row("this pair", *cells(scored.values))
        out.print(table)
    for note in notes(result):
        out.print(f"[yellow]note:[/] {escape(note)}")
    stages = ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in result.timings.items())
    out.print(f"time: {stages}", style="dim")


def _show_objects(table: ReportTable) -> None:
    """Print the objects in the columns that the terminal has room for, or else as sentences; no number is cut."""
    listed = table.first(MAX_ROWS).without("components")
    choices = [listed.without(*DISPENSABLE[:count]) for count in range(len(DISPENSABLE) + 1)]
    fitting = (shown for shown in map(_as_rich, choices) if _width(shown) <= out.width)
    widest = next(fitting, None)
    if widest is not None:
        out.print(widest)
    else:
        for row in listed.rows:
            out.print(escape(_in_words(listed, row)))
    if len(table.rows) > MAX_ROWS:
        out.print(f"and {len(table.rows) - MAX_ROWS} smaller ones", style="dim")


def _as_rich(table: ReportTable) -> Table:
    shown = plain_table()
    for place, column in enumerate(table.columns):
        wraps = column.name.startswith("centroid")  # map coordinates are long
        widest = max(len(text) for text in (column.name, *(row.cells[place] for row in table.rows)))
        shown.add_column(
            escape(column.name),
            justify="right" if column.numeric else "left",
            no_wrap=not wraps,
            min_width=None if wraps else widest,
        )
    for row in table.rows:
        shown.add_row(*map(escape, row.cells))
    return shown


def _width(table: Table) -> int:
    """Characters that a table needs to be printed with no word cut."""
    return Measurement.get(out, out.options.update(max_width=UNLIMITED), table).minimum


def _in_words(table: ReportTable, row: Row) -> str:
    """An object as one sentence: "added 0: extent [m] 0.45 × 0.40 × 0.02; points 1 234"."""
    first, *others = row.cells
    named = zip((column.name for column in table.columns[1:]), others, strict=True)
    return f"{first}: {'; '.join(f'{name} {cell}' for name, cell in named if cell)}"
