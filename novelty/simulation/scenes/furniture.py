"""Things that stand in buildings: meshes on z = 0 at the origin that face +x. Lengths in metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from novelty.simulation.meshes import Mesh, join
from novelty.simulation.poses import make_pose
from novelty.simulation.shapes import block, box, capsule, cylinder, pipe, tube


def table(length: float = 1.4, width: float = 0.7, height: float = 0.74) -> Mesh:
    """A table with four legs."""
    x, y = length / 2 - 0.06, width / 2 - 0.06
    legs = [
        box((sx * x - 0.025, sy * y - 0.025, 0), (sx * x + 0.025, sy * y + 0.025, height - 0.03))
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    return join([block(length, width, 0.03, height - 0.03), *legs])


def chair(seat: float = 0.46) -> Mesh:
    """A four-legged chair whose sitter looks to +x."""
    legs = [
        box((sx * 0.18 - 0.018, sy * 0.18 - 0.018, 0), (sx * 0.18 + 0.018, sy * 0.18 + 0.018, seat))
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    back = box((-0.22, -0.2, seat + 0.12), (-0.19, 0.2, seat + 0.45))
    posts = [box((-0.22, y - 0.015, seat), (-0.19, y + 0.015, seat + 0.12)) for y in (-0.17, 0.17)]
    return join([block(0.44, 0.42, 0.04, seat), back, *posts, *legs])


def office_chair() -> Mesh:
    """A swivel chair on five feet."""
    angles = 2 * np.pi * np.arange(5) / 5
    feet = [pipe((0, 0, 0.09), (0.3 * np.cos(a), 0.3 * np.sin(a), 0.05), 0.025) for a in angles]
    back = box((-0.27, -0.22, 0.58), (-0.21, 0.22, 1.05))
    arms = [box((-0.15, y - 0.03, 0.66), (0.12, y + 0.03, 0.69)) for y in (-0.27, 0.27)]
    column = [pipe((0, 0, 0.08), (0, 0, 0.46), 0.03), pipe((-0.2, 0, 0.5), (-0.24, 0, 0.65), 0.03)]
    return join([block(0.48, 0.48, 0.07, 0.45), back, *arms, *column, *feet])


def shelf(
    width: float = 1.0, depth: float = 0.32, height: float = 1.9, boards: int = 5, seed: int = 0
) -> Mesh:
    """An open shelf with books; it faces +x with its back at x = 0."""
    rng = np.random.default_rng(seed)
    sides = [box((0, y - 0.01, 0), (depth, y + 0.01, height)) for y in (-width / 2, width / 2)]
    levels = np.linspace(0.05, height - 0.02, boards)
    planks = [box((0, -width / 2, z), (depth, width / 2, z + 0.02)) for z in levels]
    parts = [box((0, -width / 2, 0), (0.01, width / 2, height)), *sides, *planks]
    for z in levels[:-1]:
        parts += _books(width, depth, z + 0.02, rng)
    return join(parts)


def _books(width: float, depth: float, base: float, rng: np.random.Generator) -> list[Mesh]:
    books, y = [], -width / 2 + 0.02
    while y < width / 2 - 0.12:
        thickness, tall, deep = rng.uniform(0.03, 0.09), rng.uniform(0.2, 0.32), rng.uniform(0.6, 0.9) * depth
        if rng.random() < 0.8:
            books.append(box((0.01, y, base), (deep, y + thickness, base + tall)))
        y += thickness + 0.004
    return books


def cabinet(width: float = 0.9, depth: float = 0.45, height: float = 1.2) -> Mesh:
    """A closed cabinet with two handles on a plinth; it faces +x with its back at x = 0."""
    handles = [
        box((depth, y - 0.01, height * 0.5), (depth + 0.03, y + 0.01, height * 0.62)) for y in (-0.05, 0.05)
    ]
    plinth = box((0.02, -width / 2 + 0.02, 0), (depth - 0.03, width / 2 - 0.02, 0.08))
    return join([box((0, -width / 2, 0.08), (depth, width / 2, height)), plinth, *handles])


def bench(length: float = 1.5) -> Mesh:
    """A bench along y on two slabs; its back is at x = 0."""
    slabs = [box((0.06, y - 0.03, 0), (0.38, y + 0.03, 0.42)) for y in (-length / 2 + 0.2, length / 2 - 0.2)]
    return join([box((0.02, -length / 2, 0.42), (0.42, length / 2, 0.46)), *slabs])


def sofa(width: float = 1.8) -> Mesh:
    """A sofa that faces +x with its back at x = 0."""
    arms = [box((0, y - 0.1, 0.05), (0.85, y + 0.1, 0.6)) for y in (-width / 2 + 0.1, width / 2 - 0.1)]
    return join(
        [
            box((0.02, -width / 2, 0.05), (0.83, width / 2, 0.42)),
            box((0, -width / 2, 0.05), (0.22, width / 2, 0.82)),
            *arms,
        ]
    )


def monitor() -> Mesh:
    """A computer screen on its foot; it faces +x."""
    return join(
        [
            block(0.2, 0.26, 0.015),
            box((-0.02, -0.03, 0), (0.0, 0.03, 0.2)),
            box((0, -0.28, 0.12), (0.03, 0.28, 0.46)),
        ]
    )


def plant(height: float = 1.2, seed: int = 0) -> Mesh:
    """A pot with a bush of leaves."""
    rng = np.random.default_rng(seed)
    leaves = []
    for _ in range(45):
        angle, reach = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.34)
        root = np.array([0, 0, rng.uniform(0.35, 0.6) * height])
        tip = root + np.array([reach * np.cos(angle), reach * np.sin(angle), rng.uniform(0.1, 0.4) * height])
        leaves.append(capsule(root, tip, 0.008, rng.uniform(0.02, 0.05), sides=8))
    return join([cylinder(0.16, 0.34), *leaves])


def waste_bin(radius: float = 0.15, height: float = 0.6) -> Mesh:
    """A waste bin."""
    return cylinder(radius, height)


def radiator(length: float = 1.1, height: float = 0.6) -> Mesh:
    """A ribbed radiator along y; its back is at x = 0."""
    ribs = [
        box((0.03, y, 0.12), (0.11, y + 0.035, 0.12 + height))
        for y in np.arange(-length / 2, length / 2 - 0.03, 0.06)
    ]
    pipes = [pipe((0.07, -length / 2, z), (0.07, length / 2, z), 0.015) for z in (0.14, 0.1 + height)]
    return join([*ribs, *pipes])


def door_leaf(width: float = 0.9, height: float = 2.03, thickness: float = 0.04) -> Mesh:
    """A door leaf with handles, along +x from its hinge at the origin; its front is y = 0, its body y > 0."""
    handles = [
        box((width - 0.17, y, 1.03), (width - 0.05, y + 0.025, 1.06)) for y in (-0.055, thickness + 0.03)
    ] + [box((width - 0.07, -0.055, 1.035), (width - 0.05, thickness + 0.055, 1.055))]
    return join([box((0, 0, 0.008), (width, thickness, height)), *handles])


def door_frame(width: float = 0.9, height: float = 2.05, depth: float = 0.12) -> Mesh:
    """The frame of a door opening along +x from the origin, 1 cm proud of a wall with y from 0 to `depth`."""
    low, high = -0.01, depth + 0.01
    posts = [
        box((-0.06, low, 0), (0.0, high, height + 0.06)),
        box((width, low, 0), (width + 0.06, high, height + 0.06)),
    ]
    return join([*posts, box((0, low, height), (width, high, height + 0.06))])


def carton(size: float = 0.5) -> Mesh:
    """A packing box of about `size` m, a little longer than wide."""
    return block(size * 1.15, size * 0.9, size)


def drum(size: float = 0.5) -> Mesh:
    """An upright cylinder of diameter `size` m, 1.8 times as tall."""
    return cylinder(size / 2, 1.8 * size)


def stool(height: float = 0.62) -> Mesh:
    """A round stool on three legs."""
    angles = 2 * np.pi * np.arange(3) / 3
    legs = [
        pipe((0.2 * np.cos(a), 0.2 * np.sin(a), 0.0), (0.1 * np.cos(a), 0.1 * np.sin(a), height), 0.015)
        for a in angles
    ]
    return join([cylinder(0.17, 0.04).moved(make_pose((0, 0, height))), *legs])


def workbench(length: float = 1.8, depth: float = 0.75, height: float = 0.9) -> Mesh:
    """A bench on two drawer units with an instrument shelf above; it faces +x with its back at x = 0."""
    units = [
        box((0.05, y - 0.25, 0), (depth - 0.08, y + 0.25, height - 0.04))
        for y in (-length / 2 + 0.27, length / 2 - 0.27)
    ]
    posts = [
        box((0.02, y - 0.02, height), (0.06, y + 0.02, height + 0.75))
        for y in (-length / 2 + 0.05, length / 2 - 0.05)
    ]
    board = box((0, -length / 2, height + 0.45), (0.3, length / 2, height + 0.48))
    top = box((0, -length / 2, height - 0.04), (depth, length / 2, height))
    return join([top, board, *posts, *units])


def instrument(width: float = 0.5, depth: float = 0.4, height: float = 0.3) -> Mesh:
    """A device with a knob and a display frame; it faces +x with its back at x = 0."""
    knob = pipe((depth, -width / 4, height / 2), (depth + 0.03, -width / 4, height / 2), 0.03)
    frame = box((depth, 0.02, height * 0.3), (depth + 0.01, width / 2 - 0.04, height * 0.8))
    return join([box((0, -width / 2, 0), (depth, width / 2, height)), knob, frame])


def gas_bottle(height: float = 1.5, radius: float = 0.115) -> Mesh:
    """A gas cylinder with its valve."""
    body = tube(
        (0, 0, 0),
        (0, 0, height),
        [radius, radius, radius * 0.4, 0.03],
        [0, height * 0.82, height * 0.93, height],
        24,
    )
    return join([body, pipe((-0.06, 0, height * 0.97), (0.06, 0, height * 0.97), 0.02)])


def trolley() -> Mesh:
    """A trolley with two shelves on four posts."""
    posts = [
        box((x - 0.015, y - 0.015, 0.05), (x + 0.015, y + 0.015, 0.95))
        for x in (-0.38, 0.38)
        for y in (-0.23, 0.23)
    ]
    return join([block(0.8, 0.5, 0.04, 0.2), block(0.8, 0.5, 0.04, 0.8), *posts])


def counter(length: float = 2.6) -> Mesh:
    """A reception counter along y with a raised front; it faces +x."""
    return join([block(0.7, length, 0.74), box((0.22, -length / 2, 0.74), (0.4, length / 2, 1.1))])


def stair_flight(steps: int, width: float, run: float = 0.28, rise: float = 0.175) -> Mesh:
    """A flight of stairs up along +x from the origin, `width` wide about y = 0, with open steps of 5 cm below."""
    treads = [
        box((step * run, -width / 2, step * rise - 0.05), ((step + 1) * run, width / 2, (step + 1) * rise))
        for step in range(steps)
    ]
    return join(treads)


def handrail(start: ArrayLike, end: ArrayLike, height: float = 0.9, posts: int = 5) -> Mesh:
    """A rail on posts above the line between two points, (3,) each."""
    first, last, up = (
        np.asarray(start, dtype=float),
        np.asarray(end, dtype=float),
        np.array([0.0, 0.0, height]),
    )
    feet = first + np.linspace(0, 1, posts)[:, None] * (last - first)
    return join([pipe(first + up, last + up, 0.025), *(pipe(foot, foot + up, 0.015) for foot in feet)])
