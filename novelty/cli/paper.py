"""`novelty paper`: the experiments of the paper in our numbers, as one page and its rows."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from novelty.cli.terminal import command_line, err, out, working


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
        from novelty.reproduction import FAST, FULL, reproduce, write_files, write_page

        extent = FAST if fast else FULL
        make_folder(out_folder)
    found = reproduce(extent, lambda step: err.print(f"{step} ...", style="dim"))
    with working("Drawing"):
        write_files(out_folder, found)
        write_page(out_folder / "paper.html", found, extent, command_line())
    for finding in found.findings:
        out.print(f"[bold]{finding.verdict:>8}[/]  {escape(finding.claim)}", soft_wrap=True)
    out.print(f"\nReport: {escape(str(out_folder / 'paper.html'))}", soft_wrap=True)
