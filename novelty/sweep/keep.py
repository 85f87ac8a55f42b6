"""What is kept of a run beside its row, on request: labels of all points and mixtures (see `SweepFolder`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from novelty.io import replacing
from novelty.result import Change, NoveltyResult
from novelty.scan import ScanPair
from novelty.sweep.folder import SweepFolder


def keep_scans(folder: SweepFolder, inputs: str, scans: ScanPair) -> None:
    """Write the points and the truth of a pair, unless another run has done so."""
    path = folder.scans_file(inputs)
    if path.exists():
        return
    points = scans.reference.points
    finite = points[np.isfinite(points).all(axis=1)]
    center = finite.mean(axis=0) if len(finite) else np.zeros(3)
    arrays: dict[str, Any] = {"center": center}
    for role, scan in (("reference", scans.reference), ("current", scans.current)):
        arrays[f"{role}_points"] = (scan.points - center).astype(np.float32)
        if scan.labels is not None:
            arrays[f"{role}_truth"] = scan.labels
    _write(path, arrays)


def keep_result(folder: SweepFolder, key: str, result: NoveltyResult, what: tuple[str, ...]) -> None:
    """Write the labels of a run, its mixtures, or both."""
    arrays: dict[str, Any] = {}
    for direction, change in (("added", result.added), ("removed", result.removed)):
        if "labels" in what:
            arrays |= {f"{direction}_{name}": values for name, values in _labels(change).items()}
        if "mixtures" in what:
            arrays |= {f"{direction}_{name}": values for name, values in _mixture(change).items()}
    _write(folder.result_file(key), arrays)


def _labels(change: Change) -> dict[str, Any]:
    return {
        "states": change.point_states,
        "scores": change.point_scores.astype(np.float32),
        "components": change.point_components.astype(np.int16),
    }


def _mixture(change: Change) -> dict[str, Any]:
    components = change.components
    return {
        "weights": np.array([part.weight for part in components]),
        "means": np.array([part.mean for part in components]).reshape(-1, 3),
        "covariances": np.array([part.covariance for part in components]).reshape(-1, 3, 3),
        "novel": np.array([part.novel for part in components], dtype=bool),
    }


def _write(path: Path, arrays: dict[str, Any]) -> None:
    with replacing(path) as temporary:
        np.savez_compressed(temporary, **arrays)
