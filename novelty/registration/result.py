"""What registration found, for each pair."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import torch


class RegistrationStatus(IntEnum):
    """Outcome of the registration of one pair; a doubtful one keeps the given pose and says so.

    Example:
        >>> RegistrationStatus.LOW_OVERLAP.kept_given_pose
        True
    """

    advice: str

    def __new__(cls, value: int, advice: str = "") -> RegistrationStatus:
        """Attach the advice to the integer member."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.advice = advice
        return member

    OK = 0, "nothing to do"
    NOT_ASKED = 1, "registration is off; the given pose was kept"
    UNOBSERVABLE = (
        2,
        (
            "the scans do not fix the pose in every direction (a corridor along its axis, a single plane), so it was "
            "refined in the others only; make sure the given pose is good in that direction"
        ),
    )
    TOO_FEW_CELLS = (
        3,
        "a scan has too few surface cells to register, so the given pose was kept; check the cropping",
    )
    LOW_OVERLAP = (
        4,
        (
            "too few cells have a counterpart in the other scan, so the given pose was kept; give a better pose, or "
            "lower registration.min_overlap if so much has changed"
        ),
    )
    NOT_CONVERGED = (
        5,
        (
            "registration did not settle, so the given pose was kept; give a better pose or raise "
            "registration.max_iterations"
        ),
    )
    NO_BETTER = 6, "the refined pose fits no better than the given one, which was kept"
    FAR_AWAY = (
        7,
        (
            "the scans fit best where the current one would be moved by more than half its own size, which is no "
            "refinement, so the given pose was kept; give a better pose, or crop both scans to what they share"
        ),
    )

    @property
    def kept_given_pose(self) -> bool:
        """Whether the transform is the identity."""
        return self not in (RegistrationStatus.OK, RegistrationStatus.UNOBSERVABLE)

    @property
    def noteworthy(self) -> bool:
        """Whether a reader of the result must be told."""
        return self not in (
            RegistrationStatus.OK,
            RegistrationStatus.NOT_ASKED,
            RegistrationStatus.NO_BETTER,
        )


@dataclass(frozen=True, eq=False)
class Registrations:
    """Registration of P pairs.

    Attributes:
        transforms: float64 (P, 4, 4), takes coordinates of the current scan, m, into the reference's frame; the
            identity where the given pose was kept.
        residual: float64 (P,), robust root-mean-square distance, across the surface, that remains between the two
            measurements of unchanged surfaces and that noise does not explain, m; NaN where nothing matches.
        shift: float64 (P,), how far the centre of the current scan's cells was moved, m.
        turn: float64 (P,), by how much the current scan was turned, degrees.
        overlap: float64 (P,), share of the current scan's cells with a counterpart in the reference.
        observable: int64 (P,), how many of the six degrees of freedom the scans fix; 0 where not determined.
        num_iterations: int64 (P,), steps taken.
        converged: bool (P,), whether the steps died out.
        status: int64 (P,), `RegistrationStatus`.
    """

    transforms: torch.Tensor
    residual: torch.Tensor
    shift: torch.Tensor
    turn: torch.Tensor
    overlap: torch.Tensor
    observable: torch.Tensor
    num_iterations: torch.Tensor
    converged: torch.Tensor
    status: torch.Tensor

    def __len__(self) -> int:
        """P."""
        return len(self.status)

    def status_of(self, index: int) -> RegistrationStatus:
        """The status of one pair, with its advice."""
        return RegistrationStatus(int(self.status[index]))

    def note(self, index: int) -> str:
        """What a reader of a pair's result must know; empty where there is nothing to say."""
        status = self.status_of(index)
        if not status.noteworthy:
            return ""
        measured = f"overlap {float(self.overlap[index]):.0%}, residual {float(self.residual[index]):.2g} m"
        return f"registration: {status.advice} ({measured}, {int(self.observable[index])} of 6 directions fixed)."
