"""The page: what agrees, every table and figure of section 3, times, and how it was made."""

from __future__ import annotations

import statistics
from collections import Counter
from pathlib import Path

import yaml

from novelty import __version__
from novelty.config import Config
from novelty.environment import machine, versions
from novelty.io import write_text
from novelty.report.rendering import render
from novelty.report.tables import Column, Row, Table, version_table
from novelty.reproduction import figures, printed, tables
from novelty.reproduction.charts import order_charts, simplification_chart, size_chart, threshold_charts
from novelty.reproduction.findings import Verdict
from novelty.reproduction.methods import M3C2
from novelty.reproduction.run import Extent, Reproduction
from novelty.reproduction.sensitivity import BOX_SIZE, VIEWPOINT


def write_page(path: Path, reproduction: Reproduction, extent: Extent, command: str) -> None:
    """Write one HTML file that stands alone.

    Args:
        path: The file.
        reproduction: What was computed.
        extent: How much of it.
        command: What was typed.
    """
    outcome = reproduction.outcome
    charts = {
        **order_charts(outcome.rows),
        **threshold_charts(reproduction.thresholds),
        "sizes": size_chart(outcome.rows),
        "simplification": simplification_chart(reproduction.simplification[0]),
    }
    page = {
        "title": "Novelty detection by Gaussian mixtures: the paper's experiments in our numbers",
        "facts": _facts(reproduction, extent),
        "findings": reproduction.findings,
        "verdicts": _verdicts(reproduction),
        "table_2": [(name, tables.table_2(outcome.rows, name)) for name in (printed.COMPLETE, printed.AREA)],
        "steps": tables.step_table(outcome.rows),
        "thresholds": tables.threshold_table(reproduction.thresholds),
        "found": reproduction.thresholds,
        "use": reproduction.thresholds.options,
        "static": tables.case_table(outcome.rows, "static_platform"),
        "with_m3c2": any(row.method == M3C2.key for row in outcome.rows),
        "removal": tables.case_table(outcome.rows, "removal"),
        "corridor": tables.case_table(outcome.rows, "ideal_corridor"),
        "tests": tables.test_tables(outcome.tests),
        "segmentation": tables.segmentation_table(reproduction.segmentations.rows),
        "times": tables.time_table(outcome.rows),
        "printed_seconds": printed.MIXTURE_SECONDS,
        "figures": _figures(reproduction),
        "run": _run_table(reproduction),
        "command": command,
        "left_out": outcome.left_out,
        "settings": yaml.safe_dump(Config.preset("paper").to_mapping(), sort_keys=False).strip(),
        "versions": version_table({**versions(), **machine()}),
        "version": __version__,
    }
    write_text(path, render("paper.html.j2", charts, page=page))


def _figures(reproduction: Reproduction) -> dict[str, figures.Figure]:
    outcome = reproduction.outcome
    return {
        "simplification": figures.simplification_figure(reproduction.simplification[1]),
        "corridor": figures.corridor_figure(outcome),
        "static": figures.static_figure(outcome),
        "mobile": figures.mobile_figure(outcome),
        "segmentation": figures.segmentation_figure(reproduction.segmentations),
        "frontal": figures.frontal_figure(outcome),
        "boxes": figures.sensitivity_figure(outcome, BOX_SIZE),
        "viewpoints": figures.sensitivity_figure(outcome, VIEWPOINT),
    }


def _facts(reproduction: Reproduction, extent: Extent) -> str:
    outcome = reproduction.outcome
    return " · ".join(
        (
            f"{len(outcome.simulation_seconds)} simulated pairs",
            f"{extent.repetitions} repetitions per case",
            f"{len(outcome.rows)} scored answers",
            f"{sum(reproduction.seconds.values()) / 60:.1f} minutes",
        )
    )


def _verdicts(reproduction: Reproduction) -> str:
    counts = Counter(finding.verdict for finding in reproduction.findings)
    named = {Verdict.AGREES: "agree", Verdict.PARTLY: "agree partly", Verdict.DIFFERS: "differ"}
    told = ", ".join(f"{counts[verdict]} {word}" for verdict, word in named.items())
    return f"{told}, and {counts[Verdict.OPEN]} stay open, because an interval lies across the bound"


def _run_table(reproduction: Reproduction) -> Table:
    """Wall time of every experiment; simulating a pair on its own line."""
    seconds = {**reproduction.seconds, "together": sum(reproduction.seconds.values())}
    rows = [Row((name, f"{taken:.1f}")) for name, taken in seconds.items()]
    simulated = statistics.median(reproduction.outcome.simulation_seconds)
    rows.append(Row(("of which simulating one pair (median)", f"{simulated:.2f}")))
    return Table((Column("experiment", numeric=False), Column("seconds")), tuple(rows))
