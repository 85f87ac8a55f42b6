"""The figures of a sweep's report as plotly's own data; every number in them was calculated elsewhere."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from novelty.report.sweep.costs import Costs
from novelty.report.sweep.orders import Orders, Quartiles
from novelty.report.sweep.studies import Study
from novelty.report.sweep.summary import METRICS, Spread

Figure = dict[str, Any]

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6bb1", "#7f7f7f")
"""Okabe and Ito's colours, which colour-blind readers can tell apart, on light and on dark."""

STAGE_COLOURS = ("#9fb7d9", "#0072b2", "#56b4e9", "#d55e00", "#e69f00", "#009e73", "#cc79a7")

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "x", "star", "hexagon")

INTERVAL, QUARTILES = "interval", "quartiles"
"""What a band shows: where the mean lies, or where half of the runs lie."""


@dataclass(frozen=True)
class Style:
    """How one line is told from the others; markers shrink, so that lines which coincide are all seen.

    Attributes:
        name: What the legend calls it.
        colour: Of line, band and marker.
        symbol: Of the marker.
        size: Of the marker, pixels.
        compared: Whether it is that of a second sweep: in dashes, without bands.
    """

    name: str
    colour: str
    symbol: str
    size: int
    compared: bool

    @classmethod
    def of(cls, name: str, series: int, compared: bool = False) -> Style:
        """The style of a series, by its place."""
        place = series % len(PALETTE)
        label = f"{name}, the other sweep" if compared else name
        return cls(label, PALETTE[place], SYMBOLS[place], max(13 - 2 * place, 6), compared)


def effect_figure(study: Study, metric: str, other: Study | None = None) -> Figure:
    """One score against the axis of a study: a line per series, a second sweep's in dashes."""
    traces = _effect_traces(study, metric, compared=False)
    if other is not None:
        traces += _effect_traces(other, metric, compared=True)
    xaxis: dict[str, Any] = {"title": {"text": study.axis_label}}
    figure = _figure(traces, xaxis, {"title": {"text": METRICS[metric]}})
    if study.axis is None or not study.axis.numeric:
        figure["layout"]["scattermode"] = "group"
        figure["layout"]["xaxis"]["type"] = "category"
    return figure


def _effect_traces(study: Study, metric: str, compared: bool) -> list[Figure]:
    traces: list[Figure] = []
    numbers = study.axis.values if study.axis is not None and study.axis.numeric else None
    draw = _whiskers if numbers is None else _bands_and_line
    values = study.axis_names if numbers is None else numbers
    for series, name in enumerate(study.series_names):
        scores = study.along(series, metric)
        x = [values[place] for place, _ in scores]
        if x:
            traces += draw(x, [spread for _, spread in scores], Style.of(name, series, compared))
    return traces


def _bands_and_line(x: list[Any], spreads: list[Spread], style: Style) -> list[Figure]:
    line = _line(x, [spread.interval.mean for spread in spreads], style)
    if style.compared:
        return [line]
    bands = {INTERVAL: map(_ends, spreads), QUARTILES: (spread.quartiles[::2] for spread in spreads)}
    traces = []
    for band, ends in bands.items():
        low, high = zip(*ends, strict=True)
        traces.append(_band(x, low, high, style, band))
    return [*traces, line]


def _whiskers(x: list[Any], spreads: list[Spread], style: Style) -> list[Figure]:
    """For values that have no order: points with bars, those of one value beside each other."""
    means = [spread.interval.mean for spread in spreads]
    medians = [spread.quartiles[1] for spread in spreads]
    return [
        _points(x, means, [_ends(spread) for spread in spreads], style, INTERVAL),
        _points(x, medians, [spread.quartiles[::2] for spread in spreads], style, QUARTILES),
    ]


def _points(
    x: list[Any], middle: list[float], ends: Sequence[Sequence[float]], style: Style, band: str
) -> Figure:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": x,
        "y": _plain(middle),
        "name": style.name,
        "legendgroup": style.name,
        "offsetgroup": style.name,
        "showlegend": not style.compared,
        "marker": {
            "color": style.colour,
            "size": 9,
            "symbol": f"{style.symbol}{'-open' * style.compared}",
        },
        "error_y": {
            "array": _plain(high - m for (_, high), m in zip(ends, middle, strict=True)),
            "arrayminus": _plain(m - low for (low, _), m in zip(ends, middle, strict=True)),
            "color": style.colour,
        },
        "meta": {"band": band},
        "visible": band == INTERVAL,
    }


def orders_figure(orders: Orders, study: Study) -> Figure | None:
    """K* against K_max; None where K_max does not vary."""
    if not orders.chosen:
        return None
    traces = _quartile_traces(orders.chosen, study.series_names)
    return _figure(traces, {"title": {"text": "K_max"}}, {"title": {"text": "K*"}, "rangemode": "tozero"})


def shares_figure(orders: Orders, study: Study) -> Figure | None:
    """The distribution of K*; None without order search."""
    traces = [
        {
            "type": "bar",
            "x": list(range(1, len(shares) + 1)),
            "y": _plain(100 * shares),
            "name": name,
            "marker": {"color": Style.of(name, study.series_names.index(name)).colour},
        }
        for name, shares in orders.shares.items()
        if shares.any()
    ]
    layout = _figure(traces, {"title": {"text": "K*"}, "dtick": 2}, {"title": {"text": "share of scans [%]"}})
    return layout if traces else None


def paths_figure(orders: Orders, study: Study) -> Figure | None:
    """Description length above its least against the order; None without order search.

    The axis is logarithmic, and a rise below 1 nat is drawn as 1 nat.
    """
    raised = {
        name: Quartiles(path.x, path.lower.clip(1), path.middle.clip(1), path.upper.clip(1))
        for name, path in orders.paths.items()
    }
    traces = _quartile_traces(raised, study.series_names)
    yaxis = {
        "title": {"text": "MDL above its least [nats]"},
        "type": "log",
        "dtick": 1,
        "exponentformat": "power",
    }
    return _figure(traces, {"title": {"text": "components K"}, "dtick": 2}, yaxis) if traces else None


def costs_figure(costs: Costs) -> Figure:
    """Seconds per run, by stage."""
    names = list(costs.seconds)[::-1]
    stages = next(iter(costs.seconds.values()))
    traces = [
        {
            "type": "bar",
            "orientation": "h",
            "y": names,
            "x": _plain(costs.seconds[name][stage] for name in names),
            "name": stage,
            "marker": {"color": colour},
        }
        for stage, colour in zip(stages, STAGE_COLOURS, strict=True)
    ]
    figure = _figure(traces, {"title": {"text": "seconds per run"}}, {})
    figure["layout"]["barmode"] = "stack"
    figure["layout"]["legend"]["traceorder"] = "normal"
    return figure


def _quartile_traces(lines: Mapping[str, Quartiles], names: Sequence[str]) -> list[Figure]:
    traces: list[Figure] = []
    for name, line in lines.items():
        style, x = Style.of(name, names.index(name)), line.x.tolist()
        traces += [_band(x, line.lower, line.upper, style, INTERVAL), _line(x, line.middle, style)]
    return traces


def _band(x: list[Any], low: Iterable[float], high: Iterable[float], style: Style, band: str) -> Figure:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": [*x, *x[::-1]],
        "y": [*_plain(low), *_plain(high)[::-1]],
        "fill": "toself",
        "fillcolor": f"{style.colour}2e",
        "line": {"width": 0},
        "hoverinfo": "skip",
        "name": style.name,
        "legendgroup": style.name,
        "showlegend": False,
        "meta": {"band": band},
        "visible": band == INTERVAL,
    }


def _line(x: list[Any], y: Iterable[float], style: Style) -> Figure:
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": x,
        "y": _plain(y),
        "name": style.name,
        "legendgroup": style.name,
        "showlegend": not style.compared,
        "line": {"color": style.colour, "width": 2, "dash": "dash" if style.compared else "solid"},
        "marker": {"size": style.size, "symbol": style.symbol},
    }


def _figure(traces: list[Figure], xaxis: dict[str, Any], yaxis: dict[str, Any]) -> Figure:
    layout = {
        "xaxis": {"zeroline": False, "automargin": True, **xaxis},
        "yaxis": {"zeroline": False, "automargin": True, **yaxis},
        "margin": {"l": 56, "r": 12, "t": 8, "b": 48},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom"},
        "hovermode": "closest",
    }
    return {"data": traces, "layout": layout}


def _ends(spread: Spread) -> tuple[float, float]:
    """Ends of the interval; the mean itself where there is one value."""
    interval = spread.interval
    return (interval.mean, interval.mean) if math.isnan(interval.low) else (interval.low, interval.high)


def _plain(values: Iterable[float]) -> list[float | None]:
    """Five significant digits; null for what is not defined."""
    return [float(f"{value:.5g}") if math.isfinite(value) else None for value in values]
