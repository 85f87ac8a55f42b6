"""Simulated pairs as files that any other tool can read.

A folder holds `pairs.csv` (what `novelty evaluate` reads), `conditions.csv` (case, repetition and seed of every pair)
and one folder per pair:

* `reference.ply`, `current.ply`: x, y, z in metres in scan order and, per point, `label` (0 unchanged, 1 changed,
  2 seen in one scan only, 255 not scored), `object` (a row of `objects.csv`), `state` of that object (0 unchanged,
  1 added, 2 removed, 3 moved), `hidden` (1 where the other scan could not see the place) and, of a sensor that moved,
  `sweep` (a row of the poses) and `origin_x`, `origin_y`, `origin_z`.
* `objects.csv`: every object of both worlds and its state.
* `reference_poses.txt`, `current_poses.txt`: where the sensor was believed to be, one sweep per line, the 12 numbers of
  a 3 x 4 matrix row by row, as in KITTI's odometry files; `..._true_poses.txt`: where it really was.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from novelty.io import write_ply, write_text
from novelty.scan import Scan
from novelty.simulation.experiments.experiment import ExperimentPair
from novelty.simulation.measure import Measurement
from novelty.simulation.poses import FloatArray
from novelty.simulation.simulated import SimulatedPair
from novelty.simulation.truth import Truth
from novelty.simulation.world import BodyState, compare_worlds

MANIFEST = ("name", "reference", "current", "reference_origin", "current_origin", "unit")


def write_dataset(pairs: Sequence[ExperimentPair], folder: str | Path) -> Iterator[SimulatedPair]:
    """Simulate pairs and write them, one after the other; yields each when it is on disk.

    The tables `pairs.csv` and `conditions.csv` are written when the last pair is done: a folder without them is not
    complete. The same pairs give the same bytes.

    Raises:
        InputError: A scene has no room for its change, or a file cannot be written.
    """
    folder = Path(folder)
    lines = []
    for planned in pairs:
        made = planned.simulate()
        lines.append(_write_pair(made, planned.name, folder))
        yield made
    write_text(folder / "conditions.csv", _table(*_conditions(pairs)))
    write_text(folder / "pairs.csv", _table(MANIFEST, lines))


def _conditions(pairs: Sequence[ExperimentPair]) -> tuple[list[str], list[list[Any]]]:
    keys = list(dict.fromkeys(key for pair in pairs for key in pair.case.varied))
    rows = [
        [
            pair.name,
            pair.case.name,
            *(pair.case.varied.get(key, "") for key in keys),
            pair.repetition,
            pair.seed,
        ]
        for pair in pairs
    ]
    return ["name", "case", *keys, "repetition", "seed"], rows


def _write_pair(pair: SimulatedPair, name: str, folder: Path) -> list[str]:
    """Write the folder of a pair; returns its line of the manifest."""
    states = compare_worlds(pair.before, pair.after)
    rows = [
        [row, name_of, BodyState(state).name.lower()] for row, (name_of, state) in enumerate(states.items())
    ]
    write_text(folder / name / "objects.csv", _table(("object", "name", "state"), rows))
    sides = (
        ("reference", pair.scans.reference, pair.reference),
        ("current", pair.scans.current, pair.current),
    )
    for place, (role, scan, truth) in enumerate(sides):
        measured = None if pair.measurements is None else pair.measurements[place]
        write_ply(folder / name / f"{role}.ply", scan.points, **_columns(scan, truth, list(states), measured))
        if measured is not None:
            write_text(folder / name / f"{role}_poses.txt", _kitti(measured.believed))
            write_text(folder / name / f"{role}_true_poses.txt", _kitti(measured.poses))
    files = [f"{name}/{role}.ply" for role, _, _ in sides]
    return [name, *files, _origin(pair.scans.reference), _origin(pair.scans.current), "m"]


def _columns(
    scan: Scan, truth: Truth, objects: Sequence[str], measured: Measurement | None
) -> dict[str, NDArray[Any]]:
    """What is written of every point besides its coordinates."""
    rows = np.array([objects.index(name) for name in truth.names], dtype=np.int32)
    columns: dict[str, NDArray[Any]] = {
        "label": truth.labels,
        "object": rows[truth.objects],
        "state": truth.states,
        "hidden": ~truth.observable,
    }
    if measured is None or scan.origin is None or scan.origin.ndim == 1:
        return columns
    origins = {f"origin_{axis}": scan.origin[:, place] for place, axis in enumerate("xyz")}
    return {**columns, "sweep": measured.sweeps.astype(np.int32), **origins}


def _kitti(poses: FloatArray) -> str:
    return "".join(" ".join(map(repr, row.tolist())) + "\n" for row in poses[:, :3].reshape(-1, 12))


def _origin(scan: Scan) -> str:
    """The origin as `x y z`; empty for a moving sensor, whose origins stand in its file."""
    if scan.origin is None or scan.origin.ndim != 1:
        return ""
    return " ".join(map(repr, scan.origin.tolist()))


def _table(header: Iterable[str], rows: Iterable[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
