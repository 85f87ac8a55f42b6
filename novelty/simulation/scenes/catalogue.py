"""The scenes by name."""

from __future__ import annotations

from collections.abc import Callable

from novelty.errors import InputError
from novelty.simulation.scenes.corridor import make_corridor
from novelty.simulation.scenes.hall import make_hall
from novelty.simulation.scenes.ideal import make_ideal_corridor, make_relief
from novelty.simulation.scenes.lab import make_lab
from novelty.simulation.scenes.office import make_office
from novelty.simulation.scenes.room import make_room
from novelty.simulation.scenes.scene import Scene
from novelty.simulation.scenes.stair import make_stair

SCENES: dict[str, Callable[[int], Scene]] = {
    "corridor": make_corridor,
    "room": make_room,
    "office": make_office,
    "hall": make_hall,
    "stair": make_stair,
    "lab": make_lab,
    "ideal_corridor": make_ideal_corridor,
    "relief": make_relief,
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
