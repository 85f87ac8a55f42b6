"""The labels and the mixtures that a sweep kept of a run, as the types that views are drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty.result import Change, ComponentRecord, PointState
from novelty.scan import Scan
from novelty.sweep.folder import SweepFolder

SIDES = {"added": "current", "removed": "reference"}
"""The scan that either direction labels."""


@dataclass(frozen=True, eq=False)
class KeptRun:
    """Both scans of a run and what became of their points; `added` for the current scan.

    Attributes:
        scans: By direction.
        changes: By direction; without components where the mixtures were not kept.
        unit: Of all lengths.
    """

    scans: Mapping[str, Scan]
    changes: Mapping[str, Change]
    unit: str


def load_kept(root: Path, inputs: str, key: str, unit: str) -> KeptRun | None:
    """Read what was kept; None where a file is missing or damaged, as after a killed sweep.

    Args:
        root: The folder of the sweep.
        inputs: Hash of the pair, column `inputs`.
        key: Of the run.
        unit: Of the scans as given.
    """
    folder = SweepFolder(root)
    files = (folder.scans_file(inputs), folder.result_file(key))
    if not all(file.is_file() for file in files):
        return None
    try:
        scans, result = (dict(np.load(file, allow_pickle=False)) for file in files)
        return KeptRun(
            {direction: _scan(scans, role) for direction, role in SIDES.items()},
            {
                direction: _change(result, direction, len(scans[f"{role}_points"]))
                for direction, role in SIDES.items()
            },
            unit,
        )
    # damage surfaces as what numpy and zipfile raise beneath: ValueError, BadZipFile, KeyError, EOFError ...
    except Exception:
        return None


def _scan(arrays: Mapping[str, NDArray[Any]], role: str) -> Scan:
    points = arrays[f"{role}_points"].astype(np.float64) + arrays["center"]
    return Scan(points, labels=arrays.get(f"{role}_truth"), name=role)


def _change(arrays: Mapping[str, NDArray[Any]], direction: str, num_points: int) -> Change:
    nothing = Change.not_examined(num_points)
    states = arrays.get(f"{direction}_states", nothing.point_states)
    owners = arrays.get(f"{direction}_components", nothing.point_components).astype(np.int64)
    return replace(
        nothing,
        point_labels=np.isin(states, (PointState.NOVEL, PointState.MOVED)),
        point_scores=arrays.get(f"{direction}_scores", nothing.point_scores).astype(np.float64),
        point_states=states,
        point_components=owners,
        components=_components(arrays, direction, owners) if f"{direction}_weights" in arrays else (),
    )


def _components(
    arrays: Mapping[str, NDArray[Any]], direction: str, owners: NDArray[np.int64]
) -> tuple[ComponentRecord, ...]:
    weights, novel = arrays[f"{direction}_weights"], arrays[f"{direction}_novel"]
    counts = np.bincount(owners[owners >= 0], minlength=len(weights))
    return tuple(
        ComponentRecord(
            index=k,
            weight=float(weights[k]),
            mean=arrays[f"{direction}_means"][k],
            covariance=arrays[f"{direction}_covariances"][k],
            num_points=int(counts[k]),
            novel=bool(novel[k]),
            score=np.nan,
            p_value=np.nan,
            match=-1,
            distance=np.nan,
            reason="Without a counterpart in the other scan." if novel[k] else "",
        )
        for k in range(len(weights))
        if weights[k] > 0
    )
