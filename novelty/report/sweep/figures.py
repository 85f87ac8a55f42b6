"""The figures of a sweep's report as plotly's own data; every number in them was calculated elsewhere."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from novelty.report.sweep.costs import Costs
from novelty.report.sweep.orders import Orders, Quartiles
from novelty.report.sweep.studies import Study
from novelty.report.sweep.summary import METRICS, Spread

Figure = dict[str, Any]

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6bb1", "#7f7f7f")
"""Okabe and Ito's colours, which colour-blind readers can tell apart, on light and on dark."""

STAGE_COLOURS = ("#9fb7d9", "#0072b2", "#56b4e9", "#d55e00", "#e69f00", "#009e73", "#cc79a7")

INTERVAL, QUARTILES = "interval", "quartiles"
"""What a band shows: where the mean lies, or where half of the runs lie."""


def effect_figure(study: Study, metric: str, other: Study | None = None) -> Figure:
    """One score against the axis of a study: a line per series, a second sweep's in dashes."""
    traces = _effect_traces(study, metric, "")
    if other is not None:
        traces += _effect_traces(other, metric, "dash")
    xaxis: dict[str, Any] = {"title": {"text": study.axis_label}}
    figure = _figure(traces, xaxis, {"title": {"text": METRICS[metric]}})
    if study.axis is None or not study.axis.numeric:
        figure["layout"]["scattermode"] = "group"
        figure["layout"]["xaxis"]["type"] = "category"
    return figure


def _effect_traces(study: Study, metric: str, dash: str) -> list[Figure]:
    traces: list[Figure] = []
    numbers = study.axis.values if study.axis is not None and study.axis.numeric else None
    draw = _whiskers if numbers is None else _band_and_line
    values = study.axis_names if numbers is None else numbers
    for series, name in enumerate(study.series_names):
        scores = study.along(series, metric)
        x = [values[place] for place, _ in scores]
        spreads = [spread for _, spread in scores]
        if x:
            traces += draw(x, spreads, f"{name}, the other sweep" if dash else name, _colour(series), dash)
    return traces


def _band_and_line(x: list[Any], spreads: list[Spread], name: str, colour: str, dash: str) -> list[Figure]:
    low, high = zip(*(_ends(spread) for spread in spreads), strict=True)
    lower, upper = zip(*((spread.quartiles[0], spread.quartiles[2]) for spread in spreads), strict=True)
    means = [spread.interval.mean for spread in spreads]
    return [
        *(
            []
            if dash
            else [
                _band(x, low, high, name, colour, INTERVAL),
                _band(x, lower, upper, name, colour, QUARTILES),
            ]
        ),
        _line(x, means, name, colour, dash),
    ]


def _whiskers(x: list[Any], spreads: list[Spread], name: str, colour: str, dash: str) -> list[Figure]:
    """For values that have no order: a point and a bar beside each other."""
    traces = []
    for band in (INTERVAL, QUARTILES):
        ends = [_ends(s) if band == INTERVAL else (s.quartiles[0], s.quartiles[2]) for s in spreads]
        middle = [s.interval.mean if band == INTERVAL else s.quartiles[1] for s in spreads]
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": x,
                "y": _plain(middle),
                "name": name,
                "legendgroup": name,
                "offsetgroup": name,
                "showlegend": not dash,
                "marker": {"color": colour, "size": 9, "symbol": "diamond-open" if dash else "circle"},
                "error_y": {
                    "array": _plain(high - m for (_, high), m in zip(ends, middle, strict=True)),
                    "arrayminus": _plain(m - low for (low, _), m in zip(ends, middle, strict=True)),
                    "color": colour,
                },
                "meta": {"band": band},
                "visible": band == INTERVAL,
            }
        )
    return traces


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
            "marker": {"color": _colour(study.series_names.index(name))},
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
        if len(path.x)
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
        colour = _colour(names.index(name))
        x = line.x.tolist()
        traces += [
            _band(x, line.lower, line.upper, name, colour, INTERVAL),
            _line(x, line.middle, name, colour, ""),
        ]
    return traces


def _band(
    x: list[Any], low: Iterable[float], high: Iterable[float], name: str, colour: str, band: str
) -> Figure:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": [*x, *x[::-1]],
        "y": [*_plain(low), *_plain(high)[::-1]],
        "fill": "toself",
        "fillcolor": f"{colour}2e",
        "line": {"width": 0},
        "hoverinfo": "skip",
        "name": name,
        "legendgroup": name,
        "showlegend": False,
        "meta": {"band": band},
        "visible": band == INTERVAL,
    }


def _line(x: list[Any], y: Iterable[float], name: str, colour: str, dash: str) -> Figure:
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": x,
        "y": _plain(y),
        "name": name,
        "legendgroup": name,
        "showlegend": not dash,
        "line": {"color": colour, "width": 2, "dash": dash or "solid"},
        "marker": {"size": 6},
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


def _colour(series: int) -> str:
    return PALETTE[series % len(PALETTE)]


def _plain(values: Iterable[float]) -> list[float | None]:
    """Five significant digits; null for what is not defined."""
    return [float(f"{value:.5g}") if math.isfinite(value) else None for value in values]
