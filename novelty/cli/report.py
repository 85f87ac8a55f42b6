"""`novelty report`: what a sweep found, from its rows."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from novelty.cli.terminal import out, working

if TYPE_CHECKING:
    from novelty.report.benchmarks import Benchmarks
    from novelty.report.sweep import SweepRuns


class Format(StrEnum):
    """What a report can be written as."""

    HTML = "html"
    CSV = "csv"
    LATEX = "latex"
    PNG = "png"
    PDF = "pdf"


EXTENSIONS = {form: ".tex" if form is Format.LATEX else f".{form}" for form in Format}


def report(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="DIR", help="Folder of a sweep, as given to `novelty sweep --out`."),
    ] = None,
    *,
    compare: Annotated[
        Path | None,
        typer.Option(metavar="DIR2", help="Another sweep over the same pairs: paired differences beside."),
    ] = None,
    out_file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Where to; DIR/report.html unless said.")
    ] = None,
    form: Annotated[
        Format | None,
        typer.Option(
            "--format",
            help="html unless the ending of FILE says otherwise; png and pdf need the extra 'figures'.",
        ),
    ] = None,
    benchmarks: Annotated[
        Path | None,
        typer.Option(metavar="JSON", help="Timings of `make bench`; without DIR, a page of them."),
    ] = None,
) -> None:
    """Make one page, or tables and figures for a paper, of a sweep.

    The page is one HTML file that opens without a network.
    """
    chosen = form or _told_by(out_file)
    if folder is None and (benchmarks is None or compare is not None or chosen is not Format.HTML):
        raise typer.BadParameter("name the folder of a sweep, or --benchmarks JSON alone", param_hint="DIR")
    if benchmarks is not None and chosen is not Format.HTML:
        raise typer.BadParameter("benchmarks are shown in html only", param_hint="--benchmarks")
    target = out_file or (folder or Path()) / f"report{EXTENSIONS[chosen]}"
    if chosen in (Format.PNG, Format.PDF) and target.suffix.lower() != EXTENSIONS[chosen]:
        raise typer.BadParameter(f"expected a file ending in {EXTENSIONS[chosen]}", param_hint="--out")
    with working("Reading the rows"):
        from novelty.report.benchmarks import Benchmarks, write_benchmark_page
        from novelty.report.sweep import SweepRuns

        timings = Benchmarks.read(benchmarks) if benchmarks else None
        runs = SweepRuns.read(folder) if folder else None
        other = SweepRuns.read(compare) if compare else None
    with working(f"Writing {target}"):
        if runs is not None:
            _write(chosen, target, runs, other, timings)
        elif timings is not None:
            write_benchmark_page(target, timings)
    out.print(f"Report: {escape(str(target))}", soft_wrap=True)


def _told_by(file: Path | None) -> Format:
    """The format that the ending of a file names; html without one."""
    if file is None:
        return Format.HTML
    known = {extension: form for form, extension in EXTENSIONS.items()}
    if file.suffix.lower() not in known:
        raise typer.BadParameter(
            f"expected a file ending in {', '.join(known)}; or say --format", param_hint="--out"
        )
    return known[file.suffix.lower()]


def _write(
    form: Format, target: Path, runs: SweepRuns, other: SweepRuns | None, timings: Benchmarks | None
) -> None:
    from novelty.report.sweep import write_sweep_csv, write_sweep_latex, write_sweep_page, write_sweep_plots

    match form:
        case Format.HTML:
            write_sweep_page(target, runs, other=other, benchmarks=timings)
        case Format.CSV:
            write_sweep_csv(target, runs, other)
        case Format.LATEX:
            write_sweep_latex(target, runs, other)
        case Format.PNG | Format.PDF:
            write_sweep_plots(target, runs, other)
