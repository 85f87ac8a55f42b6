"""The 2x2 contingency table of ground truth against system response (section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from novelty.errors import InputError


@dataclass(frozen=True)
class ContingencyTable:
    """Counts of points, as Python integers: their products are exact however large the scans.

    |               | called novel          | not called novel      |
    |---------------|-----------------------|-----------------------|
    | is novel      | A = `true_positives`  | B = `false_negatives` |
    | is not novel  | C = `false_positives` | D = `true_negatives`  |
    """

    true_positives: int
    false_negatives: int
    false_positives: int
    true_negatives: int

    @classmethod
    def from_labels(
        cls, truth: ArrayLike, predicted: ArrayLike, ignore: ArrayLike | None = None
    ) -> ContingencyTable:
        """Count the points of each kind.

        Args:
            truth: Whether each point is novel, bool (N,).
            predicted: Whether each point was called novel, bool (N,).
            ignore: Points that are not counted, bool (N,); None counts all.

        Raises:
            InputError: The lengths differ, or an array holds something else than truth values.
        """
        is_novel = _truth_values(truth, "truth")
        called = _truth_values(predicted, "predicted", len(is_novel))
        kept = (
            np.ones(len(is_novel), bool)
            if ignore is None
            else ~_truth_values(ignore, "ignore", len(is_novel))
        )
        counts = np.bincount(2 * is_novel[kept] + called[kept], minlength=4)
        true_negatives, false_positives, false_negatives, true_positives = map(int, counts)
        return cls(true_positives, false_negatives, false_positives, true_negatives)

    @property
    def total(self) -> int:
        """All points that are scored, n = A + B + C + D."""
        return self.novel + self.not_novel

    @property
    def novel(self) -> int:
        """A + B, the points that are novel in the ground truth."""
        return self.true_positives + self.false_negatives

    @property
    def not_novel(self) -> int:
        """C + D, the points that are not novel in the ground truth."""
        return self.false_positives + self.true_negatives

    @property
    def called_novel(self) -> int:
        """A + C, the points that were called novel."""
        return self.true_positives + self.false_positives

    @property
    def not_called_novel(self) -> int:
        """B + D, the points that were not called novel."""
        return self.false_negatives + self.true_negatives

    @property
    def determinant(self) -> int:
        """AD - BC: positive where truth and response agree more often than by chance."""
        return self.true_positives * self.true_negatives - self.false_negatives * self.false_positives


def _truth_values(values: ArrayLike, name: str, length: int | None = None) -> NDArray[np.bool_]:
    array = np.asarray(values)
    if array.ndim != 1 or (length is not None and len(array) != length):
        raise InputError(f"{name} must have shape ({'N' if length is None else length},); got {array.shape}.")
    if array.dtype != bool and not np.isin(array, (0, 1)).all():
        raise InputError(
            f"{name} must hold truth values (bool, or 0 and 1); found {np.unique(array)[:5].tolist()}. "
            "Use evaluate_labels for a scan's labels."
        )
    return array.astype(bool)
