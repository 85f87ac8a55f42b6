"""The folder that a run leaves behind: a record, both scans with their labels, and the page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.evaluation import LabelledScores
from novelty.io import refuse_overwriting, write_json, write_ply
from novelty.report.page import write_report
from novelty.report.record import result_record
from novelty.report.run import Run
from novelty.result import Change, NoveltyResult
from novelty.scan import Scan, ScanPair

RECORD, CURRENT, REFERENCE, REPORT = "result.json", "current.ply", "reference.ply", "report.html"
"""The files of the folder."""


def write_outputs(
    folder: str | Path,
    pair: ScanPair,
    result: NoveltyResult,
    run: Run,
    scores: Mapping[str, LabelledScores] | None = None,
) -> None:
    """Write `result.json`, `current.ply`, `reference.ply` and `report.html`.

    Args:
        folder: Where to; made where needed.
        pair: The two scans as given.
        result: What was found.
        run: How it was found.
        scores: Agreement with the ground truth for `added` and `removed`, where it is known.

    Raises:
        InputError: The folder cannot be written to, or scans lie there that must not be overwritten.
        MissingDependencyError: Open3D, which writes PLY, cannot be loaded.
    """
    check_folder(folder, [scan.name for scan in (pair.reference, pair.current) if scan.name])
    target = make_folder(folder)
    try:
        write_json(target / RECORD, result_record(pair, result, run, scores or {}))
        write_labelled_scan(target / CURRENT, pair.current, result.added)
        write_labelled_scan(target / REFERENCE, pair.reference, result.removed)
        write_report(target / REPORT, pair, result, run, scores)
    except OSError as error:
        raise InputError(f"{target}: the results cannot be written: {error.strerror or error}.") from None


def check_folder(folder: str | Path, inputs: Iterable[str | Path]) -> None:
    """Make sure that results in this folder overwrite neither the inputs nor scans that no comparison wrote.

    Args:
        folder: Where the results go.
        inputs: The scans that are compared: their files, or names that may be files.

    Raises:
        InputError: They would.
    """
    target = Path(folder)
    scans = [target / CURRENT, target / REFERENCE]
    refuse_overwriting([*scans, target / RECORD, target / REPORT], inputs, "choose another folder")
    if not (target / RECORD).exists():
        for scan in scans:
            if scan.exists():
                raise InputError(
                    f"{scan}: the results would overwrite this scan, which no comparison wrote; choose another folder."
                )


def make_folder(folder: str | Path) -> Path:
    """Make the folder that results go to, before the work that leads to them.

    Raises:
        InputError: The folder cannot be made.
    """
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{target}: the folder cannot be made: {error.strerror or error}.") from None
    return target


def write_labelled_scan(path: str | Path, scan: Scan, change: Change) -> None:
    """Write a scan with what became of each point.

    Per vertex: `novelty` (uint8, 0 or 1), `state` (uint8, see `PointState`), `score` (float, NaN where not
    examined), `component` (int, -1 none), `p_value` (float) where the detector has p-values, and the ground truth
    `label` where the scan has it.
    """
    properties: dict[str, NDArray[Any]] = {
        "novelty": change.point_labels.astype(np.uint8),
        "state": change.point_states,
        "score": change.point_scores.astype(np.float32),
        "component": change.point_components.astype(np.int32),
    }
    if np.isfinite(change.point_p_values).any():
        properties["p_value"] = change.point_p_values.astype(np.float32)
    if scan.labels is not None:
        properties["label"] = scan.labels
    write_ply(path, scan.points, **properties)
