"""The answer: what is new, what is gone, point by point, component by component, object by object."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray


class PointState(IntEnum):
    """What became of a point; a point is labelled novel exactly in the states NOVEL and MOVED."""

    UNCHANGED = 0
    NOVEL = 1
    OCCLUDED = 2
    UNOBSERVED = 3
    MOVED = 4
    NOT_EXAMINED = 255


class ResultStatus(StrEnum):
    """How far an answer can be trusted; `NoveltyResult.message` says why."""

    OK = "ok"
    NOTED = "noted"
    FAILED = "failed"


@dataclass(frozen=True, eq=False)
class ComponentRecord:
    """One component of a scan's mixture and what the detector made of it; lengths in the unit of the scan as given.

    Attributes:
        index: Its row in the mixture.
        weight: pi_k.
        mean: (3,).
        covariance: (3, 3).
        num_points: Examined points whose most probable component it is.
        novel: Whether it has no counterpart in the other scan.
        score: Higher = more novel.
        p_value: NaN where the detector has no null distribution.
        match: Component of the other mixture that explains it, -1 none.
        distance: Ground distance to that match (lengths in metres), NaN without one.
        reason: One sentence.
    """

    index: int
    weight: float
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    num_points: int
    novel: bool
    score: float
    p_value: float
    match: int
    distance: float
    reason: str

    def __repr__(self) -> str:
        """In one line, without covariance."""
        return _short(
            self, index=self.index, novel=self.novel, num_points=self.num_points, mean=_rounded(self.mean)
        )


@dataclass(frozen=True, eq=False)
class ObjectRecord:
    """Novel points in contact, seen as one object; lengths in the unit of the scan as given.

    Attributes:
        index: Its place in `Change.objects`.
        kind: `added`, `removed`, or `moved` when it is the same thing as an object of the other scan.
        components: Rows of the components in the mixture that its points belong to.
        neighbours: Other objects that share responsibilities with it (section 2.4.1), by index.
        num_points: Points of the scan that belong to it.
        centroid: (3,).
        extent: (3,) edge lengths of its oriented box, longest first.
        rotation: (3, 3), the columns are the box's axes.
        center: (3,) centre of the box.
        score: Highest score of its components; the median of its points' scores where there are no components.
        p_value: Twice the median of its points' p-values, 1 at most: valid however these depend on each other
            (Rueger 1978). NaN where the detector has none.
        counterpart: The same thing in the other scan, a place in the other `Change.objects`; -1 unless moved.
        motion: (4, 4) from its place in the reference scan to its place in the current one, both in the frame of the
            reference scan (the poses as registration left them); None unless moved.
    """

    index: int
    kind: str
    components: tuple[int, ...]
    neighbours: tuple[int, ...]
    num_points: int
    centroid: NDArray[np.float64]
    extent: NDArray[np.float64]
    rotation: NDArray[np.float64]
    center: NDArray[np.float64]
    score: float
    p_value: float
    counterpart: int = -1
    motion: NDArray[np.float64] | None = None

    def __repr__(self) -> str:
        """In one line, without rotation and motion."""
        where = {"centroid": _rounded(self.centroid), "extent": _rounded(self.extent)}
        return _short(self, index=self.index, kind=self.kind, num_points=self.num_points, **where)


@dataclass(frozen=True, eq=False)
class Change:
    """One direction of the answer for one scan: `added` labels the current scan, `removed` the reference scan.

    Arrays are in the order of the scan as given and have its length N.

    Attributes:
        point_labels: bool (N,), True for the states NOVEL and MOVED.
        point_scores: float64 (N,), higher = more novel; NaN where not examined.
        point_p_values: float64 (N,), probability of a score at least as high without any change. Of refined labels,
            which are scored by the distance from the other scan's surface, by the distances that the scan's own points
            keep from surfaces they had no part in; without refinement the detector's, of the point or its component.
            NaN where not examined, or where the detector has no null distribution.
        point_states: uint8 (N,), see `PointState`.
        point_components: int64 (N,), most probable component, -1 where not examined or judged without components.
        point_objects: int64 (N,), object that each point belongs to, -1 for points that are not novel.
        components: All components of the scan's mixture.
        objects: The novel points, grouped.
    """

    point_labels: NDArray[np.bool_]
    point_scores: NDArray[np.float64]
    point_p_values: NDArray[np.float64]
    point_states: NDArray[np.uint8]
    point_components: NDArray[np.int64]
    point_objects: NDArray[np.int64]
    components: tuple[ComponentRecord, ...]
    objects: tuple[ObjectRecord, ...]

    def __repr__(self) -> str:
        """In one line: how many points, components and objects, without the arrays."""
        return _short(
            self,
            points=len(self.point_states),
            novel=int(self.point_labels.sum()),
            occluded=self.count(PointState.OCCLUDED),
            unobserved=self.count(PointState.UNOBSERVED),
            components=len(self.components),
            objects=len(self.objects),
        )

    @property
    def num_examined(self) -> int:
        """Number of points about which something is said."""
        return len(self.point_states) - self.count(PointState.NOT_EXAMINED)

    def count(self, state: PointState) -> int:
        """Number of points in a state."""
        return int((self.point_states == state).sum())

    @classmethod
    def not_examined(cls, num_points: int) -> Change:
        """The change of a scan about which nothing can be said."""
        return cls(
            point_labels=np.zeros(num_points, dtype=bool),
            point_scores=np.full(num_points, np.nan),
            point_p_values=np.full(num_points, np.nan),
            point_states=np.full(num_points, PointState.NOT_EXAMINED, dtype=np.uint8),
            point_components=np.full(num_points, -1, dtype=np.int64),
            point_objects=np.full(num_points, -1, dtype=np.int64),
            components=(),
            objects=(),
        )


@dataclass(frozen=True, eq=False)
class NoveltyResult:
    """What changed between the two scans of one pair.

    Attributes:
        name: The pair's name.
        changed: Whether anything changed at all.
        p_value: Probability of the evidence if nothing had changed, to which what the other scan could not see does not
            belong; NaN where the detector has none.
        distance: Distance between the two mixtures (eq. 8; lengths in metres); NaN where the detector has none.
        status: Whether the answer stands, stands with notes, or could not be given.
        message: The notes, or the reason of the failure; empty when there is nothing to say.
        timings: Seconds per stage; of a batch, the batch's time divided by its number of pairs.
        registration: What registration did to the poses; None where it was not asked for.
        added: Labels of the current scan.
        removed: Labels of the reference scan.
        details: Figures of the run that reports show: points dropped, MDL and its path per scan.
    """

    name: str
    changed: bool
    p_value: float
    distance: float
    status: ResultStatus
    message: str
    timings: dict[str, float]
    added: Change
    removed: Change
    registration: dict[str, Any] | None = None
    details: dict[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """In one line: the answer and how much changed."""
        answer = {"changed": self.changed, "p_value": self.p_value, "status": str(self.status)}
        return _short(self, name=self.name, **answer, added=self.added, removed=self.removed)


def _short(record: object, **shown: Any) -> str:
    return f"{type(record).__name__}({', '.join(f'{name}={value!r}' for name, value in shown.items())})"


def _rounded(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(np.round(values, 3).tolist())
