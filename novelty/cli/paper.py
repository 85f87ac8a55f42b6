"""`novelty paper`: the experiments of the paper in our numbers, as one page and its rows."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from novelty.cli.terminal import command_line, err, out, plain_table, working


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
    table = plain_table()
    table.add_column("", no_wrap=True)
    table.add_column("the paper, and our numbers", overflow="fold")
    for finding in found.findings:
        numbers = f"printed: {escape(finding.printed)}\nours: {escape(finding.ours)}"
        table.add_row(f"[bold]{finding.verdict}[/]", f"{escape(finding.claim)}\n[dim]{numbers}[/]")
    out.print(table)
    out.print(f"Report: {escape(str(out_folder / 'paper.html'))}", soft_wrap=True)
