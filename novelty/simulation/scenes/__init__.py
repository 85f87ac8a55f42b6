"""Seeded buildings to scan. z is up, the floor is z = 0, lengths in metres."""

from novelty.simulation.scenes.catalogue import SCENES, make_scene
from novelty.simulation.scenes.scene import Scene, mesh_scene

__all__ = ["SCENES", "Scene", "make_scene", "mesh_scene"]
