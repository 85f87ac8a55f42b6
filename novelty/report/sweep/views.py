"""3D views of the runs at the ends of the scale, where the sweep kept their labels and mixtures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from novelty.report.frame import Frame
from novelty.report.sweep.extremes import Extreme
from novelty.report.sweep.kept import KeptRun
from novelty.report.views import SMALL, scan_figure, scatter, thin
from novelty.result import Change
from novelty.scan import CHANGED, UNCHANGED, Scan

MISSED, FALSE_ALARM = "#d6336c", "#7048e8"
"""Colours of points that were called wrongly."""

MOST_WRONG = 3_000
"""Points of either kind that are drawn."""


def pair_views(ends: Sequence[Extreme]) -> dict[str, dict[str, Any]]:
    """Figures of both directions, by the row of the run; nothing for runs that were not kept."""
    return {str(extreme.row): _views(extreme.kept) for extreme in ends if extreme.kept is not None}


def _views(kept: KeptRun) -> dict[str, Any]:
    frame = Frame.around([scan.points for scan in kept.scans.values()]).below_ceiling()
    figures = {}
    for direction, scan in kept.scans.items():
        change = kept.changes[direction]
        figure = scan_figure(scan, change, direction, frame, kept.unit, SMALL)
        figure["data"] += _wrong_points(scan, change, frame)
        figures[direction] = figure
    return figures


def _wrong_points(scan: Scan, change: Change, frame: Frame) -> Iterator[dict[str, Any]]:
    """Points that were missed and points that were called novel and are not, where the truth is known."""
    if scan.labels is None:
        return
    kinds = (
        ("missed", MISSED, (scan.labels == CHANGED) & ~change.point_labels),
        ("false alarm", FALSE_ALARM, (scan.labels == UNCHANGED) & change.point_labels),
    )
    for name, colour, wrong in kinds:
        rows = np.flatnonzero(wrong & np.isfinite(scan.points).all(axis=1))
        if len(rows):
            shown = scan.points[thin(rows, MOST_WRONG)] - frame.shift
            label = f"{name} ({len(rows):,} points)".replace(",", " ")
            yield scatter(shown, label, {"size": 2.6, "opacity": 1.0, "color": colour}, name)
