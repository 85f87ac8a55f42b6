"""People: meshes that stand on z = 0 at the origin and face +x. Lengths in metres."""

from __future__ import annotations

from novelty.errors import InputError
from novelty.simulation.meshes import Mesh, join
from novelty.simulation.poses import make_pose
from novelty.simulation.shapes import capsule, sphere

Point = tuple[float, float, float]

PERSON_POSES: dict[str, dict[str, tuple[Point, ...]]] = {
    "standing": {
        "left leg": ((0.0, 0.10, 0.06), (0.01, 0.10, 0.48), (0.0, 0.09, 0.90)),
        "right leg": ((0.0, -0.10, 0.06), (0.01, -0.10, 0.48), (0.0, -0.09, 0.90)),
        "left arm": ((0.0, 0.21, 1.40), (-0.02, 0.26, 1.12), (0.06, 0.26, 0.86)),
        "right arm": ((0.0, -0.21, 1.40), (-0.02, -0.26, 1.12), (0.06, -0.26, 0.86)),
    },
    "walking": {
        "left leg": ((0.34, 0.09, 0.06), (0.24, 0.09, 0.50), (0.0, 0.09, 0.90)),
        "right leg": ((-0.38, -0.09, 0.10), (-0.06, -0.09, 0.48), (0.0, -0.09, 0.90)),
        "left arm": ((0.0, 0.21, 1.40), (-0.16, 0.25, 1.14), (-0.12, 0.25, 0.88)),
        "right arm": ((0.0, -0.21, 1.40), (0.12, -0.25, 1.14), (0.32, -0.23, 1.00)),
    },
    "pointing": {
        "left leg": ((0.0, 0.12, 0.06), (0.01, 0.12, 0.48), (0.0, 0.09, 0.90)),
        "right leg": ((0.05, -0.12, 0.06), (0.03, -0.12, 0.48), (0.0, -0.09, 0.90)),
        "left arm": ((0.0, 0.21, 1.40), (-0.02, 0.26, 1.12), (0.06, 0.26, 0.86)),
        "right arm": ((0.0, -0.21, 1.40), (0.24, -0.28, 1.38), (0.50, -0.32, 1.42)),
    },
}
"""Joints of a person 1.75 m tall, per pose and limb: ankle, knee, hip; shoulder, elbow, wrist."""


def person(pose: str = "standing", height: float = 1.75) -> Mesh:
    """A person of tapered limbs, trunk, neck and head.

    Raises:
        InputError: There is no such pose in `PERSON_POSES`.
    """
    if pose not in PERSON_POSES:
        raise InputError(f"A person cannot be {pose!r}; choose one of {', '.join(PERSON_POSES)}.")
    parts = [_trunk(), capsule((0, 0, 1.46), (0.02, 0, 1.56), 0.055), _head()]
    for limb, (first, joint, last) in PERSON_POSES[pose].items():
        thick = limb.endswith("leg")
        radii = (0.05, 0.065, 0.085) if thick else (0.055, 0.045, 0.035)
        parts += [capsule(first, joint, radii[0], radii[1]), capsule(joint, last, radii[1], radii[2])]
        parts.append(_foot(first) if thick else sphere(last, 0.045))
    return join(parts).scaled(height / 1.75)


def _trunk() -> Mesh:
    chest = capsule((0, 0, 1.10), (0, 0, 1.34), 0.15, 0.16).scaled((0.72, 1.12, 1.0))
    hips = capsule((0, 0, 0.93), (0, 0, 1.12), 0.15, 0.14).scaled((0.78, 1.08, 1.0))
    return join([chest, hips])


def _head() -> Mesh:
    return sphere((0, 0, 0), 0.105).scaled((0.95, 0.78, 1.15)).moved(make_pose((0.03, 0, 1.63)))


def _foot(ankle: Point) -> Mesh:
    x, y, z = ankle
    heel, toe = (x - 0.05, y, z - 0.02), (x + 0.16, y, z - 0.025)
    return capsule(heel, toe, 0.04, 0.035)
