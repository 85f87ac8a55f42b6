"""The figures of a report as plotly's own data: points, components and objects of one scan, and the MDL path.

Nothing is computed anew: a figure shows what `NoveltyResult` holds. Arrays are passed as base64, so that a
page with tens of thousands of points stays small.
"""

from __future__ import annotations

import base64
import itertools
import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty.report.frame import AXES, Frame
from novelty.result import Change, ComponentRecord, NoveltyResult, ObjectRecord, PointState
from novelty.scan import Scan

Figure = dict[str, Any]

SIGMAS = 1.5
"""Semi-axes of the ellipsoids in standard deviations, as in the paper's figures."""

MAX_BOXES = 50
"""Objects drawn with their box at most, the largest first."""

ADDED, REMOVED = "#e8590c", "#2b7de9"
PALETTE = ("#8ecae6", "#b7c9a8", "#d8b4d8", "#f2cc8f", "#9fb7d9", "#c9ada7", "#a8dadc", "#cdb4db")


@dataclass(frozen=True)
class StateStyle:
    """How the points of one state are shown.

    Attributes:
        name: What the legend calls them; empty: the kind of the change.
        colour: Empty: the colour of the change.
        opacity: From 0 to 1.
        size: Of a point, pixels.
        most: Points shown at most; more are thinned evenly.
    """

    name: str
    colour: str
    opacity: float
    size: float
    most: int


STATES = {
    PointState.NOT_EXAMINED: StateStyle("not examined", "#9aa0a6", 0.3, 1.6, 6_000),
    PointState.UNCHANGED: StateStyle("unchanged", "#8a94a1", 0.85, 1.6, 20_000),
    PointState.OCCLUDED: StateStyle("occluded in the other scan", "#c9a227", 0.7, 1.6, 6_000),
    PointState.UNOBSERVED: StateStyle("outside the other scan", "#a58fc9", 0.7, 1.6, 6_000),
    PointState.MOVED: StateStyle("moved", "#2f9e44", 1.0, 2.4, 6_000),
    PointState.NOVEL: StateStyle("", "", 1.0, 2.4, 10_000),
}
"""In the order in which they are drawn; the limits keep a page small whatever the scans."""


@dataclass(frozen=True)
class Detail:
    """How finely a scan is drawn.

    Attributes:
        points: Share of the limits in `STATES`.
        rings: Of an ellipsoid, from pole to pole.
        sectors: Of an ellipsoid, around.
    """

    points: float
    rings: int
    sectors: int


FULL, SMALL = Detail(1.0, 12, 28), Detail(0.25, 8, 16)
"""For a page of one pair, and for one of several."""


def scan_figure(
    scan: Scan, change: Change, kind: str, frame: Frame, unit: str, detail: Detail = FULL
) -> Figure:
    """Both what a scan holds and what became of it.

    Args:
        scan: The current scan for `kind` "added", the reference scan for "removed".
        change: The labels of its points.
        kind: `added` or `removed`.
        frame: The box that is shown.
        unit: Name of the scan's unit.
        detail: How finely.
    """
    points = scan.points - frame.shift
    colour = ADDED if kind == "added" else REMOVED
    traces = [
        *_point_traces(points, change, kind, colour, frame, detail),
        *(_ellipsoid(record, kind, colour, frame, detail) for record in change.components),
        *_boxes(change.objects, kind, colour, frame),
    ]
    layout = {
        "scene": frame.layout(unit),
        "margin": {"l": 0, "r": 0, "t": 0, "b": 60},
        "legend": {
            "orientation": "h",
            "yref": "container",
            "y": 0.01,
            "yanchor": "bottom",
            "itemsizing": "constant",
        },
        "hoverlabel": {"align": "left"},
        "uirevision": "keep",
    }
    return {"data": _one_legend_entry_per_group(traces), "layout": layout}


def mdl_figure(result: NoveltyResult) -> Figure | None:
    """The criterion against the order for both scans, its least value marked; None without a search."""
    traces = []
    for scan, colour in (("reference", REMOVED), ("current", ADDED)):
        path = result.details.get(scan, {}).get("mdl_path", [])
        values = np.asarray(path, dtype=np.float64)
        orders = np.flatnonzero(np.isfinite(values))
        if len(orders) < 2:  # a fit that begins with the other scan's has its order from there
            continue
        best = orders[np.argmin(values[orders])]
        traces += [
            _line(orders + 1, values[orders], f"{scan} scan", colour),
            _marker(int(best) + 1, float(values[best]), f"K* = {best + 1} ({scan})", colour),
        ]
    layout = {
        "xaxis": {"title": {"text": "components K"}, "dtick": 2},
        "yaxis": {"title": {"text": "MDL [nats]"}},
        "margin": {"l": 70, "r": 10, "t": 10, "b": 45},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom"},
    }
    return {"data": traces, "layout": layout} if traces else None


def _point_traces(
    points: NDArray[np.float64], change: Change, kind: str, colour: str, frame: Frame, detail: Detail
) -> list[dict[str, Any]]:
    finite = np.isfinite(points).all(axis=1)
    traces = []
    for state, style in STATES.items():
        rows = np.flatnonzero(finite & (change.point_states == state))
        if not len(rows):
            continue
        shown = points[thin(rows, round(detail.points * style.most))]
        label = f"{style.name or kind} ({len(rows):,} points)".replace(",", " ")
        marker = {"size": style.size, "opacity": style.opacity, "color": style.colour or colour}
        if state is PointState.UNCHANGED:
            marker |= _shaded_by_height(frame.heights(shown))
        traces.append(scatter(shown, label, marker, style.name or "novel"))
    return traces


def thin(rows: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Evenly, with a jitter: a plain stride would show stripes on scans that are images."""
    if len(rows) <= most:
        return rows
    edges = np.linspace(0, len(rows), most + 1)
    jitter = np.random.default_rng(0).random(most)
    return rows[(edges[:-1] + jitter * np.diff(edges)).astype(np.int64)]


def _shaded_by_height(heights: NDArray[np.float64]) -> dict[str, Any]:
    return {
        "color": _packed(heights),
        "colorscale": [[0, "#5f6b7a"], [1, "#aeb8c4"]],
        "showscale": False,
    }


def scatter(points: NDArray[np.float64], name: str, marker: dict[str, Any], group: str) -> dict[str, Any]:
    """Points (N, 3) as one trace of the layer of points; `group` is its entry in the legend."""
    return {
        "type": "scatter3d",
        "mode": "markers",
        **_xyz(points),
        "name": name,
        "marker": {**marker, "line": {"width": 0}},
        "hoverinfo": "skip",
        "legendgroup": group,
        "meta": {"layer": "points"},
    }


def _ellipsoid(
    record: ComponentRecord, kind: str, colour: str, frame: Frame, detail: Detail
) -> dict[str, Any]:
    sphere, faces = _unit_sphere(detail.rings, detail.sectors)
    variances, axes = np.linalg.eigh(record.covariance)
    semi_axes = SIGMAS * np.sqrt(np.maximum(variances, 0))
    surface = (sphere * semi_axes) @ axes.T + record.mean - frame.shift
    corners = dict(zip("ijk", faces.T, strict=True))
    return {
        "type": "mesh3d",
        **_xyz(surface),
        **{corner: _packed(rows, "u2") for corner, rows in corners.items()},
        "color": colour if record.novel else PALETTE[record.index % len(PALETTE)],
        "opacity": 0.75 if record.novel else 0.4,
        "flatshading": False,
        "lighting": {"ambient": 0.65, "diffuse": 0.6, "specular": 0.1, "roughness": 0.8},
        "name": f"{kind} components" if record.novel else "matched components",
        "legendgroup": "novel components" if record.novel else "matched components",
        "hovertemplate": f"<b>component {record.index}</b><br>weight {record.weight:.3f}, "
        f"{record.num_points} points<br>{_wrapped(record.reason)}<extra></extra>",
        "visible": False,
        "meta": {"layer": "mixture"},
    }


def _boxes(records: Sequence[ObjectRecord], kind: str, colour: str, frame: Frame) -> list[dict[str, Any]]:
    """The boxes of the largest objects; those of moved ones apart, in their own colour."""
    drawn = records[:MAX_BOXES]
    colours = {kind: colour, "moved": STATES[PointState.MOVED].colour}
    groups = {name: [record for record in drawn if record.kind == name] for name in colours}
    return [_box_trace(some, name, colours[name], frame) for name, some in groups.items() if some]


def _box_trace(records: Sequence[ObjectRecord], kind: str, colour: str, frame: Frame) -> dict[str, Any]:
    outlines = [_outline(record) - frame.shift for record in records]
    numbers = np.repeat([record.index for record in records], len(outlines[0]))
    return {
        "type": "scatter3d",
        "mode": "lines",
        **_xyz(np.concatenate(outlines)),
        "customdata": _packed(numbers, "i4"),
        "line": {"color": colour, "width": 3},
        "name": "object boxes",
        "legendgroup": "object boxes",
        "hovertemplate": f"object: {kind} %{{customdata}}<extra></extra>",
        "meta": {"layer": "objects"},
    }


def _outline(record: ObjectRecord) -> NDArray[np.float64]:
    """The twelve edges of an object's box, (36, 3): two corners and a gap each."""
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    corners = record.center + (signs * record.extent / 2) @ record.rotation.T
    edges = [(a, b) for a, b in itertools.combinations(range(8), 2) if (signs[a] != signs[b]).sum() == 1]
    gap = np.full(3, np.nan)
    return np.array([row for a, b in edges for row in (corners[a], corners[b], gap)])


def _one_legend_entry_per_group(traces: list[dict[str, Any]]) -> list[dict[str, Any]]:
    seen: set[str] = set()
    for trace in traces:
        trace["showlegend"] = trace["legendgroup"] not in seen
        seen.add(trace["legendgroup"])
    return traces


def _line(x: NDArray[np.int64], y: NDArray[np.float64], name: str, colour: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x.tolist(),
        "y": y.tolist(),
        "name": name,
        "line": {"color": colour, "width": 2},
    }


def _marker(x: int, y: float, name: str, colour: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [x],
        "y": [y],
        "name": name,
        "marker": {"color": colour, "size": 10},
    }


def _xyz(points: NDArray[np.float64]) -> dict[str, Any]:
    return {axis: _packed(points[:, number]) for number, axis in enumerate(AXES)}


def _packed(values: NDArray[Any], dtype: str = "f4") -> dict[str, str]:
    """An array as plotly reads it: its type and its bytes in base64."""
    content = np.ascontiguousarray(values, dtype=f"<{dtype}").tobytes()
    return {"dtype": dtype, "bdata": base64.b64encode(content).decode("ascii")}


def _wrapped(sentence: str, width: int = 60) -> str:
    return "<br>".join(textwrap.wrap(sentence, width))


@cache
def _unit_sphere(rings: int, sectors: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) and triangles (T, 3) of a sphere of radius 1."""
    polar = np.linspace(0, math.pi, rings + 1)[:, None]
    around = np.linspace(0, 2 * math.pi, sectors, endpoint=False)[None, :]
    vertices = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar) + 0 * around], axis=-1
    ).reshape(-1, 3)
    first = np.arange(rings * sectors).reshape(rings, sectors)
    right = np.roll(first, -1, axis=1)
    squares = np.stack([first, right, right + sectors, first + sectors], axis=-1).reshape(-1, 4)
    return vertices, np.concatenate([squares[:, [0, 1, 2]], squares[:, [0, 2, 3]]])
