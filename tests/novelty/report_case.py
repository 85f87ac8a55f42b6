"""A small room with a person and a box in it, and a result as the pipeline would give it."""

from __future__ import annotations

import base64

import numpy as np

from novelty.result import Change, ComponentRecord, NoveltyResult, ObjectRecord, PointState, ResultStatus
from novelty.scan import Scan, ScanPair

SETTINGS = {
    "detector": "likelihood",
    "max_components": 20,
    "seed": 0,
    "unit": "m",
    "fit": {"moments": "spread", "n_init": 1},
}


def make_pair(seed=0, num_points=6000, shift=(0.0, 0.0, 0.0), labels=True):
    """A room of 6 x 4 x 2.5 m without its near wall; the reference holds a box, the current scan a person."""
    rng = np.random.default_rng(seed)
    shift = np.asarray(shift, dtype=float)

    def scan(name, inserted, missing):
        room = _room(rng, num_points)
        points = np.concatenate([room, inserted])
        truth = np.repeat([0, 1], [len(room), len(inserted)])
        points[:missing] = np.nan
        return Scan(
            points + shift,
            origin=shift + np.array([1.0, 2.0, 1.0]),
            labels=truth if labels else None,
            name=name,
        )

    person = rng.normal((3.5, 2.0, 0.9), (0.12, 0.18, 0.35), (num_points // 10, 3))
    box = rng.uniform((1.2, 0.8, 0.0), (1.9, 1.3, 0.6), (num_points // 10, 3))
    return ScanPair(reference=scan("before", box, 0), current=scan("after", person, 7), name="room")


def make_result(pair, *, changed=True, message=""):
    """What a perfect detector would say about a pair of `make_pair`."""
    added, removed = (
        _change(scan, kind, changed) for scan, kind in ((pair.current, "added"), (pair.reference, "removed"))
    )
    path = (5e4 + 30.0 * (np.arange(1, 21) - 9.0) ** 2).tolist()
    path[3] = float("nan")
    detail = {"mdl": 5e4, "mdl_path": path, "num_components": 9, "points_dropped": {"not finite": 7}}
    return NoveltyResult(
        name=pair.name,
        changed=changed,
        p_value=1e-9 if changed else 0.7,
        distance=float("nan"),
        status=ResultStatus.NOTED if message else ResultStatus.OK,
        message=message,
        timings={"preprocess": 0.31, "fit": 0.42, "compare": 0.05, "segment": 0.08},
        added=added,
        removed=removed,
        details={"reference": detail, "current": detail},
    )


def _room(rng, num_points):
    count = num_points // 4
    u, v = rng.random((2, count, 1))
    floor = np.hstack([6 * u, 4 * v, 0 * u])
    ceiling = np.hstack([6 * v, 4 * u, 0 * u + 2.5])
    back = np.hstack([6 * u, 0 * u + 4, 2.5 * v])
    side = np.hstack([0 * u, 4 * u, 2.5 * v])
    return np.concatenate([floor, ceiling, back, side]) + rng.normal(0, 0.01, (4 * count, 3))


def _change(scan, kind, changed):
    finite = np.isfinite(scan.points).all(axis=1)
    inserted = np.zeros(scan.num_points, dtype=bool)
    inserted[-(scan.num_points // 11) :] = True
    component = np.minimum(np.arange(scan.num_points) * 8 // (scan.num_points - inserted.sum()), 7)
    component[inserted] = 8
    component[~finite] = -1
    novel = inserted & finite & changed
    components = tuple(_component(scan, component, k, changed and k == 8) for k in range(9))
    states = np.where(novel, PointState.NOVEL, PointState.UNCHANGED).astype(np.uint8)
    states[~finite] = PointState.NOT_EXAMINED
    return Change(
        point_labels=novel,
        point_scores=np.where(finite, novel * 4.0, np.nan),
        point_p_values=np.full(scan.num_points, np.nan),
        point_states=states,
        point_components=component.astype(np.int64),
        point_objects=np.where(novel, 0, -1),
        components=components,
        objects=(_object(scan.points[novel], kind),) if changed else (),
    )


def _component(scan, component, k, novel):
    own = scan.points[component == k]
    reason = (
        "No component of the other scan explains its points: <5 % of them & no more."
        if novel
        else (f"Its points are explained by component {k} of the other scan.")
    )
    return ComponentRecord(
        index=k,
        weight=len(own) / scan.num_points,
        mean=own.mean(axis=0),
        covariance=np.cov(own.T),
        num_points=len(own),
        novel=novel,
        score=12.0 if novel else 0.2,
        p_value=1e-9 if novel else 0.5,
        match=-1 if novel else k,
        distance=float("nan") if novel else 0.03,
        reason=reason,
    )


def _object(points, kind):
    return ObjectRecord(
        index=0,
        kind=kind,
        components=(8,),
        neighbours=(),
        num_points=len(points),
        centroid=points.mean(axis=0),
        extent=np.ptp(points, axis=0),
        rotation=np.eye(3),
        center=(points.min(axis=0) + points.max(axis=0)) / 2,
        score=12.0,
        p_value=1e-9,
    )


def unpack(array):
    """The numbers behind an array of a figure."""
    return np.frombuffer(base64.b64decode(array["bdata"]), f"<{array['dtype']}").astype(float)
