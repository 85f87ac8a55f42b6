"""One self-contained HTML page about a sweep, made from its rows; it opens without a network."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import yaml

from novelty import __version__
from novelty.io import write_text
from novelty.report.benchmarks import Benchmarks, benchmark_tables
from novelty.report.rendering import as_script, render
from novelty.report.sweep import figures
from novelty.report.sweep.comparison import COLUMNS, Comparison, compare
from novelty.report.sweep.costs import Costs, costs
from novelty.report.sweep.extremes import Extreme, extremes
from novelty.report.sweep.failures import failures, remarks
from novelty.report.sweep.orders import Orders, orders
from novelty.report.sweep.runs import Factor, SweepRuns
from novelty.report.sweep.studies import Study, studies
from novelty.report.sweep.summary import METRICS
from novelty.report.sweep.tables import (
    comparison_table,
    cost_table,
    extreme_table,
    reason_table,
    score_table,
    version_rows,
)
from novelty.report.sweep.views import pair_views
from novelty.report.tables import thousands
from novelty.sweep.folder import SweepFolder

MOST_REASONS = 20
"""Reasons of failures that are listed."""


@dataclass(frozen=True, eq=False)
class SweepAnalysis:
    """Everything that a report says about a sweep.

    Attributes:
        runs: The rows.
        studies: Scores against each factor.
        orders: What the order search did.
        costs: Where the time went.
        ends: The worst and the best runs; empty without scores.
    """

    runs: SweepRuns
    studies: list[Study]
    orders: Orders
    costs: Costs
    ends: list[Extreme]

    @classmethod
    def of(cls, runs: SweepRuns) -> SweepAnalysis:
        """Calculate it all."""
        cut = studies(runs)
        return cls(runs, cut, orders(runs, cut[0]), costs(runs, cut[0]), extremes(runs))

    @property
    def scored(self) -> bool:
        """Whether there was a ground truth."""
        return any(study.scored for study in self.studies)


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
    views = pair_views(runs, analysis.ends)
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
            metric: figures.effect_figure(study, metric, of_other.get(study.key)) for metric in METRICS
        }
        for study in analysis.studies
        if study.scored
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
    runs = analysis.runs
    folder = SweepFolder(runs.root)
    return {
        "title": _title(folder),
        "folder": str(runs.root),
        "facts": _facts(analysis),
        "answer": _answer(analysis),
        "metrics": METRICS,
        "studies": [_study(study) for study in analysis.studies if study.scored],
        "comparison": _comparison(comparison, runs, other) if comparison and other is not None else None,
        "orders": analysis.orders,
        "costs": cost_table(analysis.costs),
        "clock": _clock(analysis),
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
        "settings": _text(folder.sweep_file) or _configuration(runs),
        "commands": _commands(folder),
        "versions": version_rows(runs),
        "version": __version__,
    }


def _study(study: Study) -> dict[str, Any]:
    return {
        "key": study.key,
        "label": study.axis_label or "all runs",
        "series": study.series.label if study.series else "",
        "pooled": ", ".join(factor.label for factor in study.pooled),
        "tables": [score_table(study, metric) for metric in METRICS],
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


def _title(folder: SweepFolder) -> str:
    settings = yaml.safe_load(_text(folder.sweep_file) or "{}") or {}
    return str(settings.get("title") or folder.root.resolve().name)


def _facts(analysis: SweepAnalysis) -> list[tuple[str, str]]:
    """Numbers to begin with, and what they count."""
    runs = analysis.runs
    failed = int(runs.failed.sum())
    return [
        (thousands(len(runs)), "runs"),
        (thousands(len(set(runs.pair_codes.tolist()))), "pairs"),
        *((str(len(factor.values)), _many(factor)) for factor in runs.factors[:3]),
        (thousands(failed), "failed"),
        (_duration(analysis.costs.clock), "on the clock"),
    ]


def _many(factor: Factor) -> str:
    return "detectors" if factor.key == "detector" else f"values of {factor.label}"


def _answer(analysis: SweepAnalysis) -> str:
    """One sentence: which runs have the highest kappa."""
    if not analysis.scored:
        return "There was no ground truth, so there are no scores; what was found is in the rows."
    study = analysis.studies[0]
    group = max(study.groups, key=lambda group: _known(group.spreads["kappa"].interval.mean))
    factors = [factor for factor in (study.series, study.axis) if factor is not None]
    names = [f"{f.label} {f.text(place)}" for f, place in zip(factors, group.places, strict=True)]
    interval = group.spreads["kappa"].interval
    ends = "" if math.isnan(interval.low) else f" (95 % interval {interval.low:.3f} to {interval.high:.3f})"
    where = f" with {', '.join(names)}" if names else ""
    return f"Highest mean κ{where}: {interval.mean:.3f}{ends}."


def _known(value: float) -> float:
    return -math.inf if math.isnan(value) else value


def _clock(analysis: SweepAnalysis) -> str:
    spent, runs = analysis.costs, len(analysis.runs)
    parts = [f"{_duration(spent.total)} of computing"]
    if spent.clock > 0:
        parts.append(f"{_duration(spent.clock)} on the clock: {runs / spent.clock:.3g} runs per second")
    parts.append(f"{spent.workers} {'process' if spent.workers == 1 else 'processes'}")
    if not math.isnan(spent.peak_memory):
        parts.append(f"at most {spent.peak_memory / 1e9:.1f} GB of memory in a process")
    return ", ".join(parts) + "."


def _duration(seconds: float) -> str:
    if math.isnan(seconds):
        return "–"
    return f"{seconds:.1f} s" if seconds < 60 else str(timedelta(seconds=round(seconds)))


def _commands(folder: SweepFolder) -> list[str]:
    """The command lines that the sweep was started with, without repetition."""
    commands = []
    for file in sorted(folder.starts.glob("*.json")):
        try:
            commands.append(str(json.loads(_text(file)).get("command", "")))
        except ValueError:
            continue
    return [command for command in dict.fromkeys(commands) if command]


def _configuration(runs: SweepRuns) -> str:
    """The configuration of the first run, where the file of the sweep is not there."""
    settings = json.loads(runs.table["configuration"][0].as_py())
    return yaml.safe_dump(settings, sort_keys=False).strip()


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8").strip() if file.is_file() else ""
