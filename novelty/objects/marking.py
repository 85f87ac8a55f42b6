"""Moved objects in the answer: their records name each other, their points take the state MOVED."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from novelty.objects.moves import Move
from novelty.result import Change, PointState


def mark_moves(added: Change, removed: Change, moves: Sequence[Move], metres: float) -> tuple[Change, Change]:
    """Both changes with the moved objects marked, `added` first.

    Args:
        added: What is new in the current scan.
        removed: What is gone from the reference scan.
        moves: Which objects are one.
        metres: Metres of one unit of the scans.
    """
    if not moves:
        return added, removed
    motions = [_in_units(move.motion, metres) for move in moves]
    return (
        _marked(added, {m.added: (m.removed, motion) for m, motion in zip(moves, motions, strict=True)}),
        _marked(removed, {m.removed: (m.added, motion) for m, motion in zip(moves, motions, strict=True)}),
    )


def _marked(change: Change, moved: Mapping[int, tuple[int, NDArray[np.float64]]]) -> Change:
    """The change with some of its objects moved: for each its counterpart and its motion."""
    states = change.point_states.copy()
    states[np.isin(change.point_objects, list(moved))] = PointState.MOVED
    objects = tuple(
        replace(record, kind="moved", counterpart=moved[record.index][0], motion=moved[record.index][1])
        if record.index in moved
        else record
        for record in change.objects
    )
    return replace(change, point_states=states, objects=objects)


def _in_units(motion: NDArray[np.float64], metres: float) -> NDArray[np.float64]:
    scaled = motion.copy()
    scaled[:3, 3] /= metres
    return scaled
