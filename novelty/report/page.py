"""One self-contained HTML page about one pair, made from what a run left; it opens without a network."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from novelty import __version__
from novelty.environment import machine, versions
from novelty.evaluation import METRICS, LabelledScores
from novelty.io import write_text
from novelty.report.answer import evidence, headline, notes, unseen
from novelty.report.frame import AXES, Frame
from novelty.report.rendering import render
from novelty.report.run import Run
from novelty.report.tables import (
    Table,
    component_table,
    object_table,
    point_table,
    score_table,
    timing_table,
    version_table,
)
from novelty.report.views import mdl_figure, scan_figure
from novelty.result import NoveltyResult, ResultStatus
from novelty.scan import ScanPair

MAX_ROWS = 20
"""Objects that are listed at once; the others are folded away."""


def write_report(
    path: str | Path,
    pair: ScanPair,
    result: NoveltyResult,
    run: Run,
    scores: Mapping[str, LabelledScores] | None = None,
) -> None:
    """Write the page.

    Args:
        path: The file to write.
        pair: The two scans as given.
        result: What was found.
        run: How it was found.
        scores: Agreement with the ground truth for `added` and `removed`, where it is known.
    """
    frame = Frame.around([pair.reference.points, pair.current.points])
    figures = {
        "added": scan_figure(pair.current, result.added, "added", frame, run.unit),
        "removed": scan_figure(pair.reference, result.removed, "removed", frame, run.unit),
        "mdl": mdl_figure(result),
    }
    content = {"figures": figures, "frame": _frame_for_browser(frame, run.unit)}
    page = _page(pair, result, run, scores or {}, figures["mdl"] is not None)
    write_text(path, render("page.html.j2", content, page=page))


def _page(
    pair: ScanPair,
    result: NoveltyResult,
    run: Run,
    scores: Mapping[str, LabelledScores],
    has_mdl: bool,
) -> dict[str, Any]:
    objects = object_table(result, run.unit)
    name = result.name or f"{pair.reference.name or 'reference'} → {pair.current.name or 'current'}"
    return {
        "title": f"{headline(result)} — {name}",
        "name": name,
        "headline": headline(result),
        "verdict": _verdict(result),
        "facts": _facts(pair, result, run),
        "notes": [*unseen(result), *notes(result)],
        "views": _captions(result),
        "objects": objects.first(MAX_ROWS),
        "more_objects": objects.after(MAX_ROWS),
        "scores": score_table(scores) if _any_defined(scores) else None,
        "has_mdl": has_mdl,
        "components": _component_tables(result, run.unit),
        "timings": timing_table(result.timings),
        "points": point_table(pair, result),
        "command": run.command,
        "settings": yaml.safe_dump(dict(run.settings), sort_keys=False).strip(),
        "versions": version_table({**versions(), **machine()}),
        "version": __version__,
    }


def _any_defined(scores: Mapping[str, LabelledScores]) -> bool:
    values = [getattr(labelled.scores, metric.name) for labelled in scores.values() for metric in METRICS]
    values += [labelled.seen_once_called_novel for labelled in scores.values()]
    return not all(map(math.isnan, values))


def _verdict(result: NoveltyResult) -> str:
    if result.status is ResultStatus.FAILED:
        return "failed"
    return "changed" if result.changed else "same"


def _mixtures(result: NoveltyResult) -> str:
    numbers = [len(change.components) for change in (result.removed, result.added)]
    return f"mixtures of {numbers[0]} and {numbers[1]} components" if any(numbers) else ""


def _facts(pair: ScanPair, result: NoveltyResult, run: Run) -> str:
    parts = [
        f"{pair.reference.num_points:,} and {pair.current.num_points:,} points".replace(",", " "),
        _mixtures(result),
        f"detector {run.settings['detector']}",
        evidence(result),
        f"{sum(result.timings.values()):.2f} s",
    ]
    return " · ".join(part for part in parts if part)


def _captions(result: NoveltyResult) -> list[dict[str, str]]:
    added, removed = int(result.added.point_labels.sum()), int(result.removed.point_labels.sum())
    return [
        {"kind": "added", "title": "Current scan", "caption": f"{added:,} points added".replace(",", " ")},
        {
            "kind": "removed",
            "title": "Reference scan",
            "caption": f"{removed:,} points removed".replace(",", " "),
        },
    ]


def _component_tables(result: NoveltyResult, unit: str) -> list[dict[str, str | Table]]:
    sides = (("current", result.added), ("reference", result.removed))
    return [
        {
            "title": f"Components of the {scan} scan: {len(change.components)}, "
            f"{sum(record.novel for record in change.components)} without counterpart",
            "table": component_table(change, unit),
        }
        for scan, change in sides
    ]


def _frame_for_browser(frame: Frame, unit: str) -> dict[str, Any]:
    axis = frame.up_axis
    full_range = [float(frame.low[axis]), float(frame.high[axis])]
    low, high = (-full_range[1], -full_range[0]) if frame.depth_camera else full_range
    top = (frame.top - low) / (high - low)
    scene = frame.layout(unit)
    return {
        "unit": unit,
        "upAxis": axis,
        "upSign": -1 if frame.depth_camera else 1,
        "heights": [low, high],
        "fullRange": full_range,
        "top": min(1.0, math.ceil(100 * top) / 100),
        "ratio": {name: scene["aspectratio"][name] for name in AXES},
    }
