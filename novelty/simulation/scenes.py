"""Seeded buildings to scan: a corridor, a room, an office. z is up, the floor is z = 0, lengths in metres."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from novelty.errors import InputError
from novelty.simulation import furniture
from novelty.simulation.meshes import Mesh
from novelty.simulation.poses import FloatArray, make_pose, transform
from novelty.simulation.shapes import Opening, block, box, cylinder, pipe, wall
from novelty.simulation.world import World

DOOR_WIDTH = 0.9

ROBOT_RADIUS = 0.3
"""Half the width of the lane that a robot needs, m: a Pioneer 3-AT is 0.5 m wide."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A world together with what an experiment has to know about it.

    Attributes:
        name: Of the generator that made it.
        world: The objects, all doors closed.
        floor: (2, 2), lower and upper corner of the floor on which new objects may stand, m.
        viewpoint: (4, 4), where a sensor stands by default; it looks along its x axis.
        open_doors: Pose (4, 4) of every door leaf when it is open, by object name.
        movable: Names of objects that may be moved or taken away.
        focus: (3,), near which new objects go and doors open, m; None: 3 m ahead of the viewpoint.
        search: How far from the focus a free spot is looked for, m, and how far off the line of sight, degrees; the
            next where the one before has none.
        path: (W, 2), places that a robot drives by, m; None where it cannot.
        keep_free: (R, 2, 2), rectangles of the floor where nothing new may stand, lower and upper corner, m.
    """

    name: str
    world: World
    floor: FloatArray
    viewpoint: FloatArray
    open_doors: Mapping[str, FloatArray]
    movable: Sequence[str]
    focus: FloatArray | None = None
    search: Sequence[tuple[float, float]] = ((2.0, 25.0), (5.0, 180.0))
    path: FloatArray | None = None
    keep_free: FloatArray = field(default_factory=lambda: np.empty((0, 2, 2)))

    @property
    def aim(self) -> FloatArray:
        """(3,), m, the focus or what stands for it."""
        return ahead(self.viewpoint, 3.0) if self.focus is None else self.focus

    def with_focus(self, forward: float, left: float) -> Scene:
        """This scene with new objects as near as there is room to a point of the viewpoint's own frame, m."""
        near = tuple((reach, 180.0) for reach in (0.15, 0.4, 1.0, 2.0))
        return replace(self, focus=transform(self.viewpoint, (forward, left, 0.0)), search=near)

    def with_free_path(self) -> Scene:
        """This scene with nothing new in a robot's way.

        Raises:
            InputError: No path leads through the scene.
        """
        if self.path is None:
            raise InputError(f"No path for a robot leads through the scene {self.name!r}.")
        ends = np.stack([self.path[:-1], self.path[1:]], axis=1)  # (W - 1, 2, 2)
        lanes = np.stack([ends.min(axis=1) - ROBOT_RADIUS, ends.max(axis=1) + ROBOT_RADIUS], axis=1)
        return replace(self, keep_free=np.concatenate([self.keep_free, lanes]))


def make_corridor(seed: int = 0) -> Scene:
    """A corridor of about 12 m x 2.5 m: four doors to side rooms, a window, lamps, a pipe, things along the walls."""
    rng = np.random.default_rng(seed)
    length, width, height = rng.uniform(11, 13), rng.uniform(2.3, 2.7), 2.7
    starts = {side: np.array([3.4, 8.2]) + rng.uniform(-0.6, 0.6, 2) for side in ("left", "right")}
    site = _Site(World(), {}, [])
    site.shell(length, width, height, beyond=3.0)
    for side, doors in starts.items():
        site.long_wall(side, length, width, height, doors.tolist(), swing=-rng.uniform(65, 95))
    site.end_wall("near wall", (0, -width / 2), 90, width, height)
    site.end_wall("far wall", (length, width / 2), -90, width, height, window=True)
    site.outer_walls(length, width, height, beyond=3.0)
    site.ceiling_lamps([(x, 0.0) for x in np.arange(1.5, length, 2.4)], height)
    site.add("pipe", pipe((0.0, 0, 0), (length, 0, 0), 0.05), make_pose((0, width / 2 - 0.12, height - 0.12)))
    _furnish_corridor(site, starts, length, width, rng)
    floor = np.array([[0.4, -width / 2 + 0.1], [length - 0.4, width / 2 - 0.1]])
    viewpoint = make_pose((rng.uniform(1.2, 1.8), rng.uniform(-0.3, 0.3), 1.0))
    path = np.array([[0.6, -0.15 * width], [length - 0.6, -0.15 * width], [0.6, -0.15 * width]])
    return replace(site.scene("corridor", floor, viewpoint), path=path)


def make_room(seed: int = 0) -> Scene:
    """A living room about 6 m x 5 m: table and chairs, sofa, shelf, cabinet, plant, a window, a radiator, a door."""
    rng = np.random.default_rng(seed)
    length, width, height = rng.uniform(5.5, 6.5), rng.uniform(4.5, 5.5), 2.6
    site = _Site(World(), {}, [])
    site.room_shell(length, width, height, door_at=length - 2.0, swing=rng.uniform(-95, -65))
    table = np.array([length * 0.55, width * rng.uniform(-0.1, 0.1)])
    site.add(
        "table", furniture.table(1.5, 0.8), make_pose((*table, 0), yaw=rng.uniform(-20, 20)), movable=True
    )
    for number, angle in enumerate((20, 160, 250, 300)):
        _chair_at_table(
            site, f"chair {number + 1}", furniture.chair(), table, angle + rng.uniform(-12, 12), 0.95
        )
    site.add("sofa", furniture.sofa(), make_pose((length * 0.4, width / 2 - 0.02, 0), yaw=-90), movable=True)
    shelf = furniture.shelf(1.2, seed=int(rng.integers(2**31)))
    site.add("shelf", shelf, make_pose((length - 0.01, width * 0.2, 0), yaw=180), movable=True)
    cabinet = make_pose((length * 0.35, -width / 2 + 0.01, 0), yaw=90)
    site.add("cabinet", furniture.cabinet(), cabinet, movable=True)
    plant = furniture.plant(seed=int(rng.integers(2**31)))
    site.add("plant", plant, make_pose((length - 0.5, width / 2 - 0.5, 0)), movable=True)
    site.ceiling_lamps([(length / 2, 0.0)], height)
    floor = np.array([[0.4, -width / 2 + 0.3], [length - 0.4, width / 2 - 0.3]])
    viewpoint = make_pose((0.7, rng.uniform(-0.6, 0.2), 1.2))
    return site.scene("room", floor, viewpoint)


def make_office(seed: int = 0) -> Scene:
    """An office about 9 m x 7 m: six desks with screens and chairs, shelves, a cabinet, a column, a window, a door."""
    rng = np.random.default_rng(seed)
    length, width, height = rng.uniform(8.5, 9.5), rng.uniform(6.5, 7.5), 2.8
    site = _Site(World(), {}, [])
    site.room_shell(length, width, height, door_at=length - 2.6, swing=rng.uniform(-95, -65))
    for number in range(6):
        x = 2.4 + 2.4 * (number // 2)
        _desk(site, number + 1, np.array([x, (1 if number % 2 else -1) * width * 0.24]), rng)
    for number, y in enumerate((-1.3, 0.0, 1.3)):
        shelf = furniture.shelf(seed=int(rng.integers(2**31)))
        site.add(f"shelf {number + 1}", shelf, make_pose((length - 0.01, y, 0), yaw=180), movable=True)
    site.add(
        "cabinet", furniture.cabinet(height=1.4), make_pose((2.2, -width / 2 + 0.01, 0), yaw=90), movable=True
    )
    site.add("column", block(0.35, 0.35, height), make_pose((length * 0.6, 0, 0)))
    site.ceiling_lamps([(x, y) for x in (2.2, 4.6, 7.0) for y in (-width / 4, width / 4)], height)
    floor = np.array([[0.6, -width / 2 + 0.4], [length - 0.6, width / 2 - 0.4]])
    return site.scene("office", floor, make_pose((0.9, rng.uniform(-0.3, 0.3), 1.3)))


SCENES: dict[str, Callable[[int], Scene]] = {
    "corridor": make_corridor,
    "room": make_room,
    "office": make_office,
}
"""Scene generators by name: each takes a seed."""


def make_scene(name: str, seed: int = 0) -> Scene:
    """A scene by the name of its generator.

    Raises:
        InputError: There is no generator of that name in `SCENES`.
    """
    if name not in SCENES:
        raise InputError(f"There is no scene {name!r}; choose one of {', '.join(SCENES)}.")
    return SCENES[name](seed)


@dataclass
class _Site:
    """A scene under construction."""

    world: World
    open_doors: dict[str, FloatArray]
    movable: list[str]

    def add(
        self, name: str, mesh: Mesh, pose: FloatArray, reflectivity: float = 1.0, movable: bool = False
    ) -> None:
        self.world = self.world.add(name, mesh, pose, reflectivity)
        if movable:
            self.movable.append(name)

    def scene(self, name: str, floor: FloatArray, viewpoint: FloatArray) -> Scene:
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
        frame = make_pose((*corner, 0), yaw=yaw)
        pane = Opening(width * 0.3, width * 0.4, 0.95, 2.1)
        self.add(name, wall(width, height, openings=[pane] if window else []), frame)
        if window:
            glass = box((pane.start, 0.05, pane.bottom), (pane.start + pane.width, 0.06, pane.top))
            self.add(f"{name} glass", glass, frame, reflectivity=0.04)

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
        self.add("left wall", wall(length, height, openings=[pane]), left)
        glass = box((pane.start, 0.05, pane.bottom), (pane.start + pane.width, 0.06, pane.top))
        self.add("window glass", glass, left, reflectivity=0.04)
        radiator = make_pose((pane.start + pane.width / 2, width / 2 - 0.01, 0), yaw=-90)
        self.add("radiator", furniture.radiator(), radiator)
        self.end_wall("near wall", (0, -width / 2), 90, width, height)
        self.end_wall("far wall", (length, width / 2), -90, width, height)
        passage = box((-0.2, -width / 2 - 2.0, 0), (length + 0.2, -width / 2 - 1.9, height))
        self.add("passage wall", passage, np.eye(4))

    def ceiling_lamps(self, places: Sequence[tuple[float, float]], height: float) -> None:
        """Flat lamps under the ceiling at (x, y)."""
        for number, (x, y) in enumerate(places):
            self.add(f"lamp {number + 1}", block(1.2, 0.25, 0.07), make_pose((x, y, height - 0.07)))


def _furnish_corridor(
    site: _Site,
    doors: Mapping[str, NDArray[np.float64]],
    length: float,
    width: float,
    rng: np.random.Generator,
) -> None:
    """Stand one or two things into every stretch of wall between the doors."""
    makers: list[tuple[str, Callable[[], Mesh]]] = [
        ("cabinet", furniture.cabinet),
        ("bench", furniture.bench),
        ("radiator", furniture.radiator),
        ("plant", lambda: furniture.plant(seed=int(rng.integers(2**31)))),
        ("bin", furniture.waste_bin),
        ("shelf", lambda: furniture.shelf(0.9, 0.28, seed=int(rng.integers(2**31)))),
    ]
    order = rng.permutation(len(makers))
    slots = [(side, place) for side, starts in doors.items() for place in _stretches(starts, length)]
    for (side, place), index in zip(slots, order, strict=True):
        name, make = makers[index]
        inset = 0.22 if name in {"plant", "bin"} else 0.01
        y, yaw = (width / 2 - inset, -90.0) if side == "left" else (-width / 2 + inset, 90.0)
        site.add(name, make(), make_pose((place, y, 0), yaw=yaw), movable=name != "radiator")
    board = box((0, 0, 0), (1.2, 0.02, 0.8))
    site.add("notice board", board, make_pose((doors["left"][0] + 1.6, width / 2 - 0.03, 1.2)))
    extinguisher = make_pose((doors["right"][0] - 0.5, -width / 2 + 0.1, 0.7))
    site.add("extinguisher", cylinder(0.08, 0.5, sides=16), extinguisher, movable=True)


def _stretches(starts: NDArray[np.float64], length: float) -> list[float]:
    """Middles of the three stretches of wall before, between and after two doors."""
    return [
        float(starts[0]) - 1.3,
        float(starts.mean() + DOOR_WIDTH / 2),
        float(starts[1] + DOOR_WIDTH + length) / 2,
    ]


def _chair_at_table(
    site: _Site, name: str, mesh: Mesh, table: FloatArray, angle: float, reach: float
) -> None:
    x, y = table + reach * np.array([np.cos(np.radians(angle)), 0.8 * np.sin(np.radians(angle))])
    site.add(name, mesh, make_pose((x, y, 0), yaw=angle + 180), movable=True)


def _desk(site: _Site, number: int, place: FloatArray, rng: np.random.Generator) -> None:
    """A desk with a screen and, on one long side, its chair."""
    pose = make_pose((*place, 0), yaw=rng.uniform(-4, 4))
    site.add(f"desk {number}", furniture.table(1.6, 0.8), pose)
    screen = pose @ make_pose((rng.uniform(-0.3, 0.3), 0.2, 0.74), yaw=-90 + rng.uniform(-20, 20))
    site.add(f"screen {number}", furniture.monitor(), screen, movable=True)
    seat = pose @ make_pose(
        (rng.uniform(-0.3, 0.3), -rng.uniform(0.6, 0.9), 0), yaw=90 + rng.uniform(-40, 40)
    )
    site.add(f"chair {number}", furniture.office_chair(), seat, movable=True)


def footprints(world: World) -> FloatArray:
    """Rectangles (objects, 2, 2) on the floor, lower and upper corner, taken up by what stands below head height."""
    boxes = [
        np.stack([body.vertices.min(axis=0), body.vertices.max(axis=0)]) for body in world.bodies.values()
    ]
    return np.array(
        [corners[:, :2] for corners in boxes if corners[0, 2] < 1.9 and corners[1, 2] > 0.02],
        dtype=np.float64,
    ).reshape(-1, 2, 2)


def ahead(viewpoint: FloatArray, distance: float) -> FloatArray:
    """The point (3,) straight ahead of a pose."""
    return transform(viewpoint, (distance, 0.0, 0.0))
