"""U_T and U_R of structural matching by the least probability of error (section 3.2; Blanco et al. 2010).

The joint distribution of distance d and relative difference delta is estimated by histograms, for valid (v) and for
invalid (w) pairings, taken as equally probable beforehand:

    P_err(U_T, U_R) = P(d < U_T, delta < U_R | w) / 2 + (1 - P(d < U_T, delta < U_R | v)) / 2.

Every value up to the largest d and delta that occur is tried: beyond these P_err changes no more, so that the least
one lies inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.calibration.pairings import Pairings
from novelty.errors import InputError

Array = NDArray[np.float64]

NODE_STEP = 0.25
"""Step from one value of U_T to the next."""

ARC_STEP = 0.1
"""Step from one value of U_R to the next."""

MOST_VALUES = 400
"""Values of either threshold that are tried at most: up to U_T = 100 and U_R = 40."""

FLAT = 0.005
"""Probabilities of error that differ by less than this are the same."""


@dataclass(frozen=True, eq=False)
class ThresholdGrid:
    """The values that are tried: the upper edges of the histograms' bins.

    Attributes:
        node: Of U_T (T,).
        arc: Of U_R (R,).
        complete: Whether they reach beyond the largest d, and beyond the largest delta.
    """

    node: Array
    arc: Array
    complete: tuple[bool, bool]

    def histogram(self, rows: Array) -> Array:
        """Share of the rows (n, 2) in each bin of d and delta (T, R)."""
        edges = (np.insert(self.node, 0, 0.0), np.insert(self.arc, 0, 0.0))
        histogram, _, _ = np.histogram2d(rows[:, 0], rows[:, 1], bins=edges)
        return histogram / max(len(rows), 1)


@dataclass(frozen=True, eq=False)
class LeastError:
    """U_T and U_R of the least probability of error.

    Attributes:
        node: U_T.
        arc: U_R.
        error: P_err at these.
        grid: The values that were tried.
        valid: Joint histogram of d and delta of valid pairings (T, R), every pair of scans with the same weight.
        invalid: The same of invalid pairings.
        notes: Where larger values err as little, or where the largest value tried errs least: what to do.
    """

    node: float
    arc: float
    error: float
    grid: ThresholdGrid
    valid: Array
    invalid: Array
    notes: tuple[str, ...]


def least_error_thresholds(pairs: Sequence[Pairings]) -> LeastError:
    """U_T and U_R; every pair of scans weighs the same, whatever the number of its components.

    Args:
        pairs: The pairings of labelled pairs of scans.

    Raises:
        InputError: No pair has both valid and invalid pairings.
    """
    usable = [pairings for pairings in pairs if len(pairings.valid) and len(pairings.invalid)]
    if not usable:
        raise InputError(
            "no two components of a pair hold the same unchanged place, so that U_T and U_R cannot be learnt; "
            "check that the scans of each pair lie in one frame and that label 0 marks unchanged points."
        )
    grid = _grid_over(usable)
    valid = _mean([grid.histogram(pairings.valid) for pairings in usable])
    invalid = _mean([grid.histogram(pairings.invalid) for pairings in usable])
    error = (_below(invalid) + 1 - _below(valid)) / 2
    # The middle of the flat bottom: its edge, the first minimum, would fit these pairs and no others.
    least = error <= error.min() + FLAT
    bottom = np.argwhere(least)
    node, arc = bottom[np.argmin(np.linalg.norm(bottom - bottom.mean(axis=0), axis=1))]
    notes = (
        *_notes("U_T", grid.node, least[:, arc], grid.complete[0]),
        *_notes("U_R", grid.arc, least[node], grid.complete[1]),
    )
    return LeastError(
        float(grid.node[node]), float(grid.arc[arc]), float(error[node, arc]), grid, valid, invalid, notes
    )


def _grid_over(pairs: Sequence[Pairings]) -> ThresholdGrid:
    """Values up to the first one above everything that occurs, or as many as are tried at most."""
    largest = np.max(
        [rows.max(axis=0) for pairings in pairs for rows in (pairings.valid, pairings.invalid)], axis=0
    )
    wanted = [int(value // step) + 1 for value, step in zip(largest, (NODE_STEP, ARC_STEP), strict=True)]
    node, arc = (
        np.round(step * np.arange(1, min(count, MOST_VALUES) + 1), 6)
        for count, step in zip(wanted, (NODE_STEP, ARC_STEP), strict=True)
    )
    return ThresholdGrid(node, arc, (wanted[0] <= MOST_VALUES, wanted[1] <= MOST_VALUES))


def _mean(histograms: Sequence[Array]) -> Array:
    return np.mean(histograms, axis=0)


def _below(histogram: Array) -> Array:
    """P(d < U_T, delta < U_R) on the grid of thresholds."""
    return histogram.cumsum(axis=0).cumsum(axis=1)


def _notes(name: str, values: Array, least: NDArray[np.bool_], complete: bool) -> tuple[str, ...]:
    """What to say of a threshold whose largest value tried is among those of least error (T,), the other one fixed."""
    if not least[-1]:
        return ()
    if not complete:
        return (
            f"{name}: the largest value tried, {values[-1]:g}, errs least; check the unit of the scans, or let metres "
            "weigh less by `structural_matching.length_scale`.",
        )
    above = np.flatnonzero(~least)
    first = values[above[-1] + 1] if len(above) else values[0]
    return (
        f"{name}: every value from {first:g} on errs as little on these pairs, where this constraint tells no wrong "
        "pairing from a right one; pairs with other changes may need a smaller value.",
    )
