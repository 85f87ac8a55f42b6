"""`novelty demo`: a simulated corridor, three detectors, their scores, and the page to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from novelty.cli.terminal import command_line, out, working


def demo(
    *,
    out_folder: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Where the scans and reports are written.")
    ] = Path("demo-output"),
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the simulation.")] = 0,
) -> None:
    """Simulate a corridor that changes, run every detector, write the reports."""
    with working("Starting"):
        from novelty.cli.scoring import cells, score_result, score_table, scored_pair
        from novelty.config import Config, detector_names
        from novelty.pipeline import detect
        from novelty.report import Run, headline, make_folder, write_outputs
        from novelty.simulation import demo_pair

        make_folder(out_folder)
    with working("Simulating a corridor, twice"):
        pair = demo_pair(seed)
    sizes = f"{pair.reference.num_points:,} and {pair.current.num_points:,} points".replace(",", " ")
    out.print(f"A furnished corridor before and after a change: {sizes}.")
    table = score_table("detector")
    answers = []
    for name in _chosen_first(Config().detector, detector_names()):
        config = Config(detector=name, seed=seed)
        with working(f"Comparing: {name}"):
            result = detect(pair, config)
        scores = score_result(pair, result)
        table.add_row(name, *cells(scored_pair(name, result, scores).values))
        with working(f"Writing {out_folder / name}"):
            write_outputs(out_folder / name, pair, result, Run(config.to_mapping(), command_line()), scores)
        answers.append((name, headline(result)))
    out.print(table)
    for name, answer in answers:
        out.print(
            f"{name}: [bold]{answer}[/]\n  {escape(str(out_folder / name / 'report.html'))}", soft_wrap=True
        )
    out.print("\nOpen a report in a browser; the scans with their labels lie beside it.")


def _chosen_first(chosen: str, names: list[str]) -> list[str]:
    return sorted(names, key=lambda name: name != chosen)
