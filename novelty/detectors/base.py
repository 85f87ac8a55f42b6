"""What a detector is: it fits the two scans of every pair and says which components have no counterpart."""

from __future__ import annotations

import abc
from dataclasses import dataclass

import torch

from novelty.fitting import FitPlan, Models, fit_independently
from novelty.preprocess.prepared import PreparedPairs


@dataclass(frozen=True, eq=False)
class ComponentNovelty:
    """One direction of a comparison: what the components of one mixture are to the other mixture.

    For `Comparison.added` the components are those of the current mixtures, for `Comparison.removed` those of
    the reference mixtures.

    Attributes:
        novel: bool (P, K), True for a component without counterpart; False for padding.
        scores: float64 (P, K), higher = more novel, comparable within a detector; NaN for padding.
        matches: int64 (P, K), the component of the other mixture that explains it, -1 none.
        distances: float64 (P, K), ground distance to that match; NaN without one.
        reasons: For each pair, one sentence per component: what it was matched to, or why nothing matches.
        point_scores: float64 (N,) over the packed examined points of that scan, for a detector that judges
            points; None where points follow their components.
        p_values: float64 (P, K), probability of a score at least this high without any change; None where the
            detector has no null distribution.
        point_p_values: float64 (N,), the same for every point; None likewise.
    """

    novel: torch.Tensor
    scores: torch.Tensor
    matches: torch.Tensor
    distances: torch.Tensor
    reasons: tuple[tuple[str, ...], ...]
    point_scores: torch.Tensor | None = None
    p_values: torch.Tensor | None = None
    point_p_values: torch.Tensor | None = None


@dataclass(frozen=True, eq=False)
class PointNovelty:
    """One direction of a comparison that was made point by point, without a mixture.

    Attributes:
        novel: bool (N,) over the packed examined points of that scan.
        scores: float64 (N,), higher = more novel; NaN where there was nothing to compare with.
    """

    novel: torch.Tensor
    scores: torch.Tensor


@dataclass(frozen=True, eq=False)
class Comparison:
    """Both directions of a comparison of P pairs.

    Attributes:
        added: The current mixtures' components, or the current scans' points, judged against the reference.
        removed: Those of the references judged against the current scan.
        distance: float64 (P,), distance between the two mixtures (eq. 8); NaN where the detector has none.
        p_value: float64 (P,), probability of the evidence if nothing changed; NaN where the detector has none.
        notes: For each pair, what a reader of the result must know (a search not proven maximal, say).
    """

    added: ComponentNovelty | PointNovelty
    removed: ComponentNovelty | PointNovelty
    distance: torch.Tensor
    p_value: torch.Tensor
    notes: tuple[tuple[str, ...], ...]


class Detector(abc.ABC):
    """A detector is a frozen dataclass of its parameters; it keeps no state between calls."""

    @property
    def asks_visibility(self) -> bool:
        """Whether what it calls novel is judged by what the other scan could see, where that is configured."""
        return True

    @property
    def asks_refinement(self) -> bool:
        """Whether its labels are refined inside components, where that is configured."""
        return True

    def fit(self, batch: PreparedPairs, plan: FitPlan) -> Models:
        """Fit the mixtures this detector compares; by default every scan on its own."""
        return fit_independently(batch, plan)

    @abc.abstractmethod
    def compare(self, batch: PreparedPairs, models: Models) -> Comparison:
        """Compare the mixtures of every pair, both directions in one call.

        A pair with an empty side never raises: without a reference nothing can be called novel; its note says so.
        """
