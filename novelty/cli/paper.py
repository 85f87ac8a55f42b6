"""`novelty paper`: the experiments of the paper in our numbers, as one page and its rows."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from novelty.cli.terminal import command_line, err, out, working

if TYPE_CHECKING:
    from novelty.reproduction import Finding

WIDTH = 80
"""Columns that a verdict and its sentence take at most."""


def paper(
    *,
    out_folder: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Where the page and the rows are written.")
    ] = Path("paper-output"),
    fast: Annotated[
        bool, typer.Option("--fast", help="Two repetitions and four maps instead of ten and twelve.")
    ] = False,
) -> None:
    """Run the paper's experiments, write its tables and figures in our numbers."""
    with working("Starting"):
        from novelty.report import make_folder
        from novelty.reproduction import FAST, FULL, matplotlib_figure, reproduce, write_files, write_page

        matplotlib_figure()  # before minutes of work that could not be drawn
        extent = FAST if fast else FULL
        make_folder(out_folder)
    found = reproduce(extent, lambda step: err.print(f"{step} ...", style="dim"))
    with working("Drawing"):
        write_files(out_folder, found)
        write_page(out_folder / "paper.html", found, extent, command_line())
    for finding in found.findings:
        out.print(_line(finding), soft_wrap=True)
    out.print(f"Report: {escape(str(out_folder / 'paper.html'))}", soft_wrap=True)


def _line(finding: Finding) -> str:
    """The verdict (agrees, partly, differs or open) and the sentence of the paper beside it."""
    verdict, sentence = str(finding.verdict), textwrap.wrap(finding.claim, WIDTH - 9)
    first, *more = map(escape, sentence)
    return "\n".join((f"[bold]{verdict:<9}[/]{first}", *(f"{'':9}{line}" for line in more)))
