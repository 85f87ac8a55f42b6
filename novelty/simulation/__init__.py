"""Simulated scans of changing buildings, with exact ground truth.

>>> from novelty.simulation import demo_pair
>>> pair = demo_pair(seed=0)
>>> pair.current.num_points > 50_000
True
"""

from novelty.simulation.changes import CHANGES, apply_changes
from novelty.simulation.drive import Drive, drive, measure_drive
from novelty.simulation.experiments import (
    Analysis,
    Case,
    Experiment,
    ExperimentPair,
    Setup,
    experiment_names,
    load_experiment,
)
from novelty.simulation.measure import Measurement, measure, simulate
from novelty.simulation.meshes import Mesh, join, load_mesh
from novelty.simulation.pairs import (
    PairOptions,
    corridor_pair,
    demo_pair,
    office_pair,
    room_pair,
    sample_pair,
    simulate_pair,
)
from novelty.simulation.poses import make_pose
from novelty.simulation.raycast import RayScene
from novelty.simulation.scenes import SCENES, Scene, make_scene, mesh_scene
from novelty.simulation.sensors import SENSORS, Sensor, get_sensor
from novelty.simulation.simulated import SimulatedPair, pair_up
from novelty.simulation.truth import Truth, find_truth
from novelty.simulation.world import Body, BodyState, World, compare_worlds

__all__ = [
    "CHANGES",
    "SCENES",
    "SENSORS",
    "Analysis",
    "Body",
    "BodyState",
    "Case",
    "Drive",
    "Experiment",
    "ExperimentPair",
    "Measurement",
    "Mesh",
    "PairOptions",
    "RayScene",
    "Scene",
    "Sensor",
    "Setup",
    "SimulatedPair",
    "Truth",
    "World",
    "apply_changes",
    "compare_worlds",
    "corridor_pair",
    "demo_pair",
    "drive",
    "experiment_names",
    "find_truth",
    "get_sensor",
    "join",
    "load_experiment",
    "load_mesh",
    "make_pose",
    "make_scene",
    "measure",
    "measure_drive",
    "mesh_scene",
    "office_pair",
    "pair_up",
    "room_pair",
    "sample_pair",
    "simulate",
    "simulate_pair",
]
