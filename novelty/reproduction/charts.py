"""The plots of the page, as plotly's own data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty.evaluation import Interval, t_interval
from novelty.reproduction.methods import CALIBRATED, PRINTED, STRUCTURAL
from novelty.reproduction.printed import BEST_ORDERS
from novelty.reproduction.rows import Row, interval, matching, order_curve
from novelty.reproduction.sensitivity import BOX_SIZE, SELECTED, VIEWPOINT, default_method
from novelty.reproduction.simplification import SimplificationRow
from novelty.reproduction.thresholds import Thresholds

Chart = dict[str, Any]

BLUE, ORANGE, GREEN, VIOLET = "#2b7de9", "#e8590c", "#2f9e44", "#8250c4"
HEAT = [[0, "rgba(43,125,233,0)"], [0.1, "rgba(43,125,233,0.3)"], [1, "#12366e"]]
"""From nothing to much, on a light page and on a dark one."""

TITLES = {BOX_SIZE: "Box of twelve sizes", VIEWPOINT: "Person from twelve viewpoints"}


def order_charts(rows: Sequence[Row]) -> dict[str, Chart]:
    """Fig. 18: mean kappa against K for each study, both printed methods, the default detector for comparison."""
    return {experiment: _order_chart(rows, experiment) for experiment in (BOX_SIZE, VIEWPOINT)}


def size_chart(rows: Sequence[Row]) -> Chart:
    """Kappa against the size of the box, at the order that MDL selects."""
    part = matching(rows, experiment=BOX_SIZE, analysis=SELECTED.name)
    traces = []
    methods = (*PRINTED, CALIBRATED, default_method())
    for method, colour in zip(methods, (ORANGE, BLUE, VIOLET, GREEN), strict=True):
        own = matching(part, method=method.key)
        sizes = [float(row.varied.split("=")[1]) for row in own]
        kappas = [row.kappa for row in own]
        traces.append(_line(sizes, kappas, method.title, colour) | {"mode": "lines+markers"})
    return {"data": traces, "layout": _layout("edge of the box [m]", "κ")}


def simplification_chart(rows: Sequence[SimplificationRow]) -> Chart:
    """Share of points kept against sigma_max, on flat and on curved ground."""
    limits = sorted({row.max_surface_variation for row in rows})
    names = {"kept_curved": "most curved tenth", "kept": "all points", "kept_flat": "flattest half"}
    traces = []
    for (column, name), colour in zip(names.items(), (ORANGE, GREEN, BLUE), strict=True):
        spans = {
            limit: t_interval([getattr(row, column) for row in rows if row.max_surface_variation == limit])
            for limit in limits
        }
        traces += _banded(spans, name, colour)
    layout = _layout("σ<sub>max</sub>", "share of points kept")
    layout["xaxis"] |= {"type": "log", "tickvals": limits, "ticktext": [f"{limit:g}" for limit in limits]}
    layout["yaxis"] |= {"range": [0, None], "tickformat": ".0%"}
    return {"data": traces, "layout": layout}


def threshold_charts(found: Thresholds) -> dict[str, Chart]:
    """Section 3.2: the joint histograms of valid and of invalid pairings, with the printed thresholds and ours."""
    return {
        "valid": _histogram_chart(found, found.valid, "Same place in both maps"),
        "invalid": _histogram_chart(found, found.invalid, "Different places"),
    }


def _histogram_chart(found: Thresholds, shares: NDArray[np.float64], title: str) -> Chart:
    node, arc = found.bins
    printed = STRUCTURAL.config.structural_matching
    heat = {
        "type": "heatmap",
        "x": node.tolist(),
        "y": arc.tolist(),
        "z": np.round(100 * shares.T, 4).tolist(),
        "colorscale": HEAT,
        "colorbar": {"title": {"text": "%"}, "thickness": 12},
        "hovertemplate": "d %{x:.2f}, δ %{y:.2f}: %{z:.2f} %<extra></extra>",
    }
    corners = {
        f"printed: U<sub>T</sub> {printed.node_threshold:g}, U<sub>R</sub> {printed.arc_threshold:g}": (
            printed.node_threshold,
            printed.arc_threshold,
            ORANGE,
        ),
        f"least error: U<sub>T</sub> {found.node:g}, U<sub>R</sub> {found.arc:g}": (
            found.node,
            found.arc,
            VIOLET,
        ),
    }
    boxes = [
        _line([0, x, x], [y, y, 0], name, colour) | {"line": {"color": colour, "width": 3}}
        for name, (x, y, colour) in corners.items()
    ]
    layout = _layout("d (eq. 9)", "δ (eqs. 11, 12)") | {"title": {"text": title, "font": {"size": 15}}}
    layout["xaxis"] |= {"range": [0, float(node[-1])]}
    layout["yaxis"] |= {"range": [0, float(arc[-1])]}
    return {"data": [heat, *boxes], "layout": layout}


def _order_chart(rows: Sequence[Row], experiment: str) -> Chart:
    traces = []
    for method, colour in zip((*PRINTED, CALIBRATED), (ORANGE, BLUE, VIOLET), strict=True):
        traces += _banded(order_curve(rows, experiment, method), method.title, colour)
    default = default_method()
    span = interval(matching(rows, experiment=experiment, method=default.key))
    orders = sorted({row.order for row in rows if row.experiment == experiment and row.order})
    reference = _line(
        [orders[0], orders[-1]], [span.mean] * 2, f"{default.title}, K<sub>max</sub> = {orders[-1]}", GREEN
    )
    reference["line"] |= {"dash": "dash"}
    layout = _layout("components K", "mean κ") | {"title": {"text": TITLES[experiment], "font": {"size": 15}}}
    layout["xaxis"] |= {"dtick": 2}
    layout["shapes"] = [
        {
            "type": "line",
            "x0": k,
            "x1": k,
            "yref": "paper",
            "y0": 0,
            "y1": 1,
            "line": {"dash": "dot", "width": 1, "color": "#888"},
        }
        for k in BEST_ORDERS
    ]
    return {"data": [*traces, reference], "layout": layout}


def _banded(spans: Mapping[Any, Interval], name: str, colour: str) -> list[dict[str, Any]]:
    """A line of means and the band of their intervals."""
    places = list(spans)
    low, high = [spans[p].low for p in places], [spans[p].high for p in places]
    band = {
        "type": "scatter",
        "mode": "lines",
        "x": places + places[::-1],
        "y": high + low[::-1],
        "fill": "toself",
        "fillcolor": _faint(colour),
        "line": {"width": 0},
        "hoverinfo": "skip",
        "showlegend": False,
    }
    line = _line(places, [spans[p].mean for p in places], name, colour) | {"mode": "lines+markers"}
    return [line] if any(map(math.isnan, low)) else [band, line]


def _line(x: Sequence[float], y: Sequence[float], name: str, colour: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": list(x),
        "y": list(y),
        "name": name,
        "line": {"color": colour, "width": 2},
        "hovertemplate": "%{x}: %{y:.3f}<extra>" + name + "</extra>",
    }


def _faint(colour: str) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.14)"


def _layout(x: str, y: str) -> dict[str, Any]:
    return {
        "xaxis": {"title": {"text": x}},
        "yaxis": {"title": {"text": y}, "range": [-0.1, 1.05]},
        "margin": {"l": 55, "r": 10, "t": 36, "b": 45},
        "legend": {"orientation": "h", "y": -0.22, "yanchor": "top"},
    }
