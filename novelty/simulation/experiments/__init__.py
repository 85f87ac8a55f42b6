"""Experiments as data: which pairs of scans are simulated, how often, and how they are to be compared.

>>> from novelty.simulation import load_experiment
>>> experiment = load_experiment("static_platform")
>>> len(experiment.pairs())
30
"""

from novelty.simulation.experiments.experiment import Analysis, Case, Experiment, ExperimentPair
from novelty.simulation.experiments.loading import experiment_names, load_experiment
from novelty.simulation.experiments.setup import Setup

__all__ = [
    "Analysis",
    "Case",
    "Experiment",
    "ExperimentPair",
    "Setup",
    "experiment_names",
    "load_experiment",
]
