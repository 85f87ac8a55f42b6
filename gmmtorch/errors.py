"""What can go wrong: errors for the caller's mistakes, statuses for what a cloud itself made impossible."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["ArgumentError", "GmmError", "SerializationError", "ShapeError", "Status"]


class GmmError(Exception):
    """Base class of every error that `gmmtorch` raises on purpose."""


class ShapeError(GmmError, ValueError):
    """A tensor has a shape that does not fit the others."""


class ArgumentError(GmmError, ValueError):
    """An option has a value outside its range, or a name that is not registered."""


class SerializationError(GmmError, ValueError):
    """A file is not a mixture file, or is damaged."""


class Status(IntEnum):
    """Outcome of a fit for one cloud of a batch: failures are data and never stop the other clouds.

    Example:
        >>> Status.EMPTY.has_mixture
        False
        >>> Status(0).advice
        'nothing to do'
    """

    advice: str

    def __new__(cls, value: int, advice: str) -> Status:
        """Attach the advice text to the integer member."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.advice = advice
        return member

    OK = 0, "nothing to do"
    FLOOR_REACHED = (
        1,
        (
            "at least one component is as thin as the covariance floor (points on an exact plane or line, or "
            "repeated points); its thickness is the floor's: raise min_std to the sensor's noise if it matters"
        ),
    )
    NOT_CONVERGED = 2, "EM was still gaining when it ran out of iterations; raise max_iterations"
    FEWER_POINTS_THAN_COMPONENTS = (
        3,
        (
            "the cloud has fewer points than components were asked for, so fewer were fitted; "
            "ask for fewer or add points"
        ),
    )
    IDENTICAL_POINTS = (
        4,
        (
            "all points are the same point: one component of the floor's size was returned; "
            "check the sensor, or drop this cloud"
        ),
    )
    EMPTY = (
        5,
        "the cloud has no point of positive weight, so there is no mixture; drop it or check the cropping",
    )
    NON_FINITE = 6, "the cloud holds NaN or infinite values, so it was not fitted; remove those points first"

    @property
    def has_mixture(self) -> bool:
        """Whether the fit produced a mixture that can be used."""
        return self not in (Status.EMPTY, Status.NON_FINITE)
