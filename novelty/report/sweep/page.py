"""One self-contained HTML page about a sweep, made from its rows; it opens without a network."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from novelty import __version__
from novelty.io import write_text
from novelty.report.benchmarks import Benchmarks, benchmark_tables
from novelty.report.rendering import as_script, render
from novelty.report.sweep import figures
from novelty.report.sweep.analysis import SweepAnalysis
from novelty.report.sweep.comparison import COLUMNS, Comparison, compare
from novelty.report.sweep.failures import failures, remarks
from novelty.report.sweep.orders import NO_SEARCH
from novelty.report.sweep.runs import SweepRuns
from novelty.report.sweep.studies import Study, studies
from novelty.report.sweep.tables import (
    comparison_table,
    cost_table,
    extreme_table,
    reason_table,
    score_table,
    version_rows,
)
from novelty.report.sweep.views import pair_views
from novelty.report.sweep.words import answer, caution, clock, facts

MOST_REASONS = 20
"""Reasons of failures that are listed."""


def write_sweep_page(
    path: str | Path,
    runs: SweepRuns,
    *,
    other: SweepRuns | None = None,
    benchmarks: Benchmarks | None = None,
) -> None:
    """Write the page.

    Args:
        path: The file to write.
        runs: The sweep.
        other: A sweep to compare it with.
        benchmarks: Timings to show below.

    Raises:
        InputError: The sweeps have no run in common.
    """
    analysis = SweepAnalysis.of(runs)
    comparison = compare(runs, other, analysis.studies[0].series) if other is not None else None
    views = pair_views(analysis.ends)
    page = _page(analysis, other, comparison, views)
    page["benchmarks"] = benchmark_tables(benchmarks) if benchmarks else []
    write_text(
        path,
        render(
            "sweep.html.j2",
            _figures(analysis, studies(other) if other is not None else []),
            page=page,
            views={row: as_script(figure) for row, figure in views.items()},
        ),
    )


def _figures(analysis: SweepAnalysis, others: Sequence[Study]) -> dict[str, Any]:
    """Everything flat that the page draws, by the place it is drawn in."""
    first = analysis.studies[0]
    of_other = {study.key: study for study in others}
    effects = {
        study.key: {
            metric: figures.effect_figure(study, metric, of_other.get(study.key))
            for metric in analysis.metrics
        }
        for study in analysis.scored
    }
    plots = {
        "chosen": figures.orders_figure(analysis.orders, first),
        "shares": figures.shares_figure(analysis.orders, first),
        "paths": figures.paths_figure(analysis.orders, first),
        "costs": figures.costs_figure(analysis.costs),
    }
    return {
        "effects": effects,
        "plots": {name: figure for name, figure in plots.items() if figure},
    }


def _page(
    analysis: SweepAnalysis,
    other: SweepRuns | None,
    comparison: Comparison | None,
    views: Mapping[str, Any],
) -> dict[str, Any]:
    runs, record = analysis.runs, analysis.record
    return {
        "title": record.title,
        "folder": str(runs.root),
        "facts": facts(analysis),
        "answer": answer(analysis),
        "caution": caution(analysis),
        "metrics": analysis.metrics,
        "studies": [_study(study, analysis.metrics) for study in analysis.scored],
        "comparison": _comparison(comparison, runs, other) if comparison and other is not None else None,
        "orders": analysis.orders,
        "no_search": NO_SEARCH,
        "costs": cost_table(analysis.costs),
        "clock": clock(analysis),
        "ends": [
            {
                "name": end,
                "table": extreme_table(runs, [extreme for extreme in analysis.ends if extreme.end == end]),
                "rows": [str(extreme.row) for extreme in analysis.ends if extreme.end == end],
            }
            for end in dict.fromkeys(extreme.end for extreme in analysis.ends)
        ],
        "shown": list(views),
        "failures": reason_table(failures(runs)[:MOST_REASONS]),
        "num_failed": int(runs.failed.sum()),
        "remarks": reason_table(remarks(runs)[:MOST_REASONS]),
        "settings": record.settings or _configuration(runs),
        "commands": record.commands,
        "versions": version_rows(runs),
        "version": __version__,
    }


def _study(study: Study, metrics: Iterable[str]) -> dict[str, Any]:
    return {
        "key": study.key,
        "label": study.axis_label or "all runs",
        "series": study.series.label if study.series else "",
        "pooled": ", ".join(factor.label for factor in study.pooled),
        "tables": [score_table(study, metric) for metric in metrics],
    }


def _comparison(comparison: Comparison, runs: SweepRuns, other: SweepRuns) -> dict[str, Any]:
    return {
        "first": str(runs.root),
        "second": str(other.root),
        "matched_by": ", ".join(comparison.matched_by),
        "differing": comparison.differing,
        "only": (comparison.only_first, comparison.only_second),
        "tables": {column: comparison_table(comparison, column) for column in COLUMNS},
    }


def _configuration(runs: SweepRuns) -> str:
    """The configuration of the first run, where the file of the sweep is not there."""
    settings = json.loads(runs.table["configuration"][0].as_py())
    return yaml.safe_dump(settings, sort_keys=False).strip()
