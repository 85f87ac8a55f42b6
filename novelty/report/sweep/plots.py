"""The figures of a report for a paper, with matplotlib: kappa, V and U against every factor, orders, MDL and time."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from novelty.errors import MissingDependencyError
from novelty.io import replacing
from novelty.report.sweep.costs import Costs, costs
from novelty.report.sweep.figures import STAGE_COLOURS, SYMBOLS, Style
from novelty.report.sweep.orders import NO_SEARCH, Orders, orders
from novelty.report.sweep.runs import SweepRuns
from novelty.report.sweep.studies import Study, studies

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

METRICS = {"kappa": r"$\kappa$", "cramers_v": "$V$", "uncertainty": "$U$"}
"""The scores of the paper (section 3.1)."""

MARKERS = dict(zip(SYMBOLS, "osD^Px*h", strict=True))
"""matplotlib's names for the markers of the page."""

WIDTH, ROW_HEIGHT = 7.2, 2.1
"""Inches; the width of a page with two columns."""


def write_sweep_plots(path: str | Path, runs: SweepRuns, other: SweepRuns | None = None) -> None:
    """Write one figure, in the format of the file's extension: a row per factor, then orders, MDL and time.

    Args:
        path: A file that ends in `.png` or `.pdf`.
        runs: The sweep.
        other: A sweep whose means are drawn in dashes.

    Raises:
        MissingDependencyError: matplotlib is not installed.
        InputError: The file cannot be written.
    """
    figure_class = _load_figure()
    cut = studies(runs)
    scored = [study for study in cut if study.scored]
    of_other = {study.key: study for study in studies(other)} if other is not None else {}
    figure: Figure = figure_class(figsize=(WIDTH, ROW_HEIGHT * (len(scored) + 1)), layout="constrained")
    grid = figure.subplots(len(scored) + 1, 3, squeeze=False)
    for row, study in zip(grid, scored, strict=False):
        for axes, (metric, symbol) in zip(row, METRICS.items(), strict=True):
            _draw_effect(axes, study, metric)
            if study.key in of_other:
                _draw_effect(axes, of_other[study.key], metric, compared=True)
            axes.set_ylabel(symbol)
    found = orders(runs, cut[0])
    _draw_shares(grid[-1][0], found, cut[0])
    _draw_paths(grid[-1][1], found, cut[0])
    _draw_costs(grid[-1][2], costs(runs, cut[0]))
    _finish(figure)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=200)


def _load_figure() -> Any:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError(
            f"Figures in PNG and PDF need matplotlib, which cannot be loaded: {error}. "
            "Run: pip install 'novelty-gmm[figures]'"
        ) from error
    return Figure


def _draw_effect(axes: Axes, study: Study, metric: str, compared: bool = False) -> None:
    axes.set_xlabel("$K_{\\max}$" if study.key == "max_components" else study.axis_label)
    if study.axis is not None and study.axis.numeric:
        _draw_lines(axes, study, metric, compared)
        if all(isinstance(value, int) for value in study.axis.values):
            axes.locator_params(axis="x", integer=True)
    else:
        _draw_whiskers(axes, study, metric, compared)
        axes.set_xticks(range(len(study.axis_names)), study.axis_names, rotation=30, ha="right")


def _draw_lines(axes: Axes, study: Study, metric: str, compared: bool) -> None:
    values = study.axis.values if study.axis else ()
    for series, name in enumerate(study.series_names):
        style, scores = Style.of(name, series, compared), study.along(series, metric)
        x = [values[place] for place, _ in scores]
        means = [spread.interval.mean for _, spread in scores]
        if compared:
            axes.plot(x, means, color=style.colour, linestyle="--", linewidth=1)
            continue
        marker, size = MARKERS[style.symbol], style.size / 2.5
        axes.plot(x, means, color=style.colour, linewidth=1, marker=marker, markersize=size, label=name)
        low, high = ([getattr(spread.interval, end) for _, spread in scores] for end in ("low", "high"))
        axes.fill_between(x, low, high, color=style.colour, alpha=0.18, linewidth=0)


def _draw_whiskers(axes: Axes, study: Study, metric: str, compared: bool) -> None:
    """For values that have no order: points with bars beside each other."""
    count = len(study.series_names)
    for series, name in enumerate(study.series_names):
        style, scores = Style.of(name, series, compared), study.along(series, metric)
        shift = 0.7 * ((series + 0.5 + 0.3 * compared) / count - 0.5)
        x = [place + shift for place, _ in scores]
        means = [spread.interval.mean for _, spread in scores]
        below = [spread.interval.mean - spread.interval.low for _, spread in scores]
        above = [spread.interval.high - spread.interval.mean for _, spread in scores]
        axes.errorbar(
            x,
            means,
            yerr=[below, above],
            fmt=MARKERS[style.symbol],
            color=style.colour,
            markersize=3,
            linewidth=1,
            fillstyle="none" if compared else "full",
            label=None if compared else name,
        )


def _draw_shares(axes: Axes, found: Orders, study: Study) -> None:
    for name, shares in found.shares.items():
        axes.step(
            range(1, len(shares) + 1),
            100 * shares,
            where="mid",
            linewidth=1.2,
            color=Style.of(name, study.series_names.index(name)).colour,
        )
    axes.set(xlabel="$K^*$", ylabel="share of scans [%]")


def _draw_paths(axes: Axes, found: Orders, study: Study) -> None:
    if not found.paths:
        axes.text(0.5, 0.5, textwrap.fill(NO_SEARCH, 30), ha="center", va="center", fontsize=6)
        axes.set_axis_off()
        return
    for name, line in found.paths.items():
        colour = Style.of(name, study.series_names.index(name)).colour
        axes.plot(line.x, line.middle.clip(1), color=colour, linewidth=1.2)
        axes.fill_between(
            line.x, line.lower.clip(1), line.upper.clip(1), color=colour, alpha=0.18, linewidth=0
        )
    axes.set(xlabel="$K$", ylabel="MDL above its least [nats]", yscale="log")


def _draw_costs(axes: Axes, spent: Costs) -> None:
    names = [name for name in spent.seconds if name != "all"][::-1]
    ends = dict.fromkeys(names, 0.0)
    for stage, colour in zip(next(iter(spent.seconds.values())), STAGE_COLOURS, strict=True):
        widths = [spent.seconds[name][stage] for name in names]
        axes.barh(names, widths, left=[ends[name] for name in names], color=colour, label=stage, height=0.7)
        ends = {name: ends[name] + width for name, width in zip(names, widths, strict=True)}
    axes.set_yticks(range(len(names)), [name.replace("_", "\n") for name in names])
    axes.set_xlabel("seconds per run")
    axes.legend(fontsize=5, ncols=2, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0))


def _finish(figure: Figure) -> None:
    for axes in figure.axes:
        axes.tick_params(labelsize=6)
        axes.xaxis.label.set_fontsize(8)
        axes.yaxis.label.set_fontsize(8)
        axes.grid(linewidth=0.3, alpha=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    handles, names = figure.axes[0].get_legend_handles_labels()
    if len(names) > 1:
        figure.legend(
            handles, names, loc="outside upper center", ncols=min(len(names), 4), fontsize=7, frameon=False
        )
