"""A scene under construction: walls with doors and windows, floors, lamps, and what is put between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from novelty.simulation.meshes import Mesh, join
from novelty.simulation.poses import FloatArray, make_pose
from novelty.simulation.scenes import furniture
from novelty.simulation.scenes.scene import Scene
from novelty.simulation.shapes import Opening, block, box, wall
from novelty.simulation.world import World

DOOR_WIDTH = 0.9

GLASS_REFLECTIVITY = 0.04
"""Share of rays that return from glass: Fresnel's reflection of one face at normal incidence, for an index of 1.5."""


@dataclass
class Site:
    """A scene under construction."""

    world: World = field(default_factory=World)
    open_doors: dict[str, FloatArray] = field(default_factory=dict)
    movable: list[str] = field(default_factory=list)

    def add(
        self, name: str, mesh: Mesh, pose: FloatArray, reflectivity: float = 1.0, movable: bool = False
    ) -> None:
        """One more object; a movable one may be moved or taken away by a change."""
        self.world = self.world.add(name, mesh, pose, reflectivity)
        if movable:
            self.movable.append(name)

    def scene(self, name: str, floor: FloatArray, viewpoint: FloatArray) -> Scene:
        """The finished scene."""
        return Scene(name, self.world, floor, viewpoint, self.open_doors, tuple(self.movable))

    def shell(self, length: float, width: float, height: float, beyond: float) -> None:
        """Floor and ceiling, reaching `beyond` the long walls."""
        low, high = (-0.2, -width / 2 - beyond), (length + 0.2, width / 2 + beyond)
        self.add("floor", box((*low, -0.1), (*high, 0.0)), np.eye(4))
        self.add("ceiling", box((*low, height), (*high, height + 0.1)), np.eye(4))

    def long_wall(
        self, side: str, length: float, width: float, height: float, doors: Sequence[float], swing: float
    ) -> None:
        """A wall along x with doors; `swing` (degrees) turns an open leaf, negative to the front of the wall."""
        left = side == "left"
        frame = make_pose((0, width / 2, 0)) if left else make_pose((length, -width / 2, 0), yaw=180)
        starts = [start if left else length - start - DOOR_WIDTH for start in doors]
        self.add(
            f"{side} wall", wall(length, height, openings=[Opening(s, DOOR_WIDTH) for s in starts]), frame
        )
        for number, start in enumerate(starts):
            self.door(f"{side} door {number + 1}", frame, start, swing)

    def door(self, name: str, frame: FloatArray, start: float, swing: float) -> None:
        """A closed door in a wall at `frame`, with its open pose."""
        self.add(f"{name} frame", furniture.door_frame(DOOR_WIDTH), frame @ make_pose((start, 0, 0)))
        closed = frame @ make_pose((start, 0, 0))
        self.add(name, furniture.door_leaf(DOOR_WIDTH), closed)
        self.open_doors[name] = closed @ make_pose(yaw=swing)

    def end_wall(
        self,
        name: str,
        corner: tuple[float, float],
        yaw: float,
        width: float,
        height: float,
        window: bool = False,
    ) -> None:
        """A wall across, with a glazed window in its middle where wanted."""
        panes = [Opening(width * 0.3, width * 0.4, 0.95, 2.1)] if window else []
        self.glazed_wall(name, make_pose((*corner, 0), yaw=yaw), width, height, panes, f"{name} glass")

    def glazed_wall(
        self, name: str, frame: FloatArray, length: float, height: float, panes: Sequence[Opening], glass: str
    ) -> None:
        """A wall with window panes, which are one object, `glass`, and hardly return anything."""
        self.add(name, wall(length, height, openings=panes), frame)
        if panes:
            sheets = [
                box((pane.start, 0.05, pane.bottom), (pane.start + pane.width, 0.06, pane.top))
                for pane in panes
            ]
            self.add(glass, join(sheets), frame, reflectivity=GLASS_REFLECTIVITY)

    def outer_walls(self, length: float, width: float, height: float, beyond: float) -> None:
        """The rooms behind the long walls: back walls and walls between them."""
        for side, sign in (("left", 1), ("right", -1)):
            y0, y1 = sign * (width / 2 + 0.12), sign * (width / 2 + beyond)
            across = sorted((y1, y1 - sign * 0.1))
            self.add(f"{side} outer wall", box((0, across[0], 0), (length, across[1], height)), np.eye(4))
            for number, x in enumerate((0.0, length / 2, length)):
                low, high = sorted((y0, y1))
                self.add(
                    f"{side} cross wall {number + 1}",
                    box((x - 0.05, low, 0), (x + 0.05, high, height)),
                    np.eye(4),
                )

    def room_shell(self, length: float, width: float, height: float, door_at: float, swing: float) -> None:
        """Four walls with a door on the right, a window and a radiator on the left, and a passage behind the door."""
        self.shell(length, width, height, beyond=2.0)
        self.long_wall("right", length, width, height, [door_at], swing)
        left = make_pose((0, width / 2, 0))
        pane = Opening(length * 0.62, length * 0.26, 0.9, 2.1)
        self.glazed_wall("left wall", left, length, height, [pane], "window glass")
        radiator = make_pose((pane.start + pane.width / 2, width / 2 - 0.01, 0), yaw=-90)
        self.add("radiator", furniture.radiator(), radiator)
        self.end_wall("near wall", (0, -width / 2), 90, width, height)
        self.end_wall("far wall", (length, width / 2), -90, width, height)
        passage = box((-0.2, -width / 2 - 2.0, 0), (length + 0.2, -width / 2 - 1.9, height))
        self.add("passage wall", passage, np.eye(4))

    def far_side(self, side: str, length: float, width: float, height: float, beyond: float) -> None:
        """The wall that is seen through the open doors of a long wall."""
        low, high = sorted(np.array([beyond - 0.1, beyond]) * (1 if side == "left" else -1))
        offset = width / 2 if side == "left" else -width / 2
        self.add(
            f"{side} passage wall",
            box((-0.2, offset + low, 0), (length + 0.2, offset + high, height)),
            np.eye(4),
        )

    def ceiling_lamps(self, places: Sequence[tuple[float, float]], height: float) -> None:
        """Flat lamps under the ceiling at (x, y)."""
        for number, (x, y) in enumerate(places):
            self.add(f"lamp {number + 1}", block(1.2, 0.25, 0.07), make_pose((x, y, height - 0.07)))
