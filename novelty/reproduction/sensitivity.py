"""Section 3.6: how well the changes are found with mixtures of exactly K components, for K from 8 to 20."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from novelty.config import Config
from novelty.reproduction.methods import OURS, Method
from novelty.reproduction.scoring import Outcome, simulated
from novelty.simulation.experiments import Analysis, Experiment, load_experiment

BOX_SIZE, VIEWPOINT = "box_size", "viewpoint"
"""The two experiments of the section."""

SELECTED = Analysis("selected by MDL", {})
"""The number of components that MDL chooses below K_max = 20."""


def run_sensitivity(
    name: str, methods: Sequence[Method], outcome: Outcome, most_maps: int | None = None
) -> None:
    """Score methods at every K, and the default detector as it comes, on every map.

    Args:
        name: `box_size` or `viewpoint`.
        methods: Those that are scored at every K.
        outcome: Takes what comes out.
        most_maps: Maps that are made at most, evenly taken; all when None.
    """
    experiment = _with_fewer_maps(load_experiment(name), most_maps)
    orders = sorted({analysis.settings["max_components"] for analysis in experiment.analyses})
    highest = Analysis(SELECTED.name, {"max_components": max(orders)})
    for batch in simulated(experiment, outcome):
        for method in methods:
            for order, answer in batch.bench.answers_by_order(method, {}, orders).items():
                outcome.rows += batch.rows(Analysis(f"K = {order}", {}), method.key, answer, order)
        for method in (*methods, default_method()):
            answer = batch.bench.answer(method, highest.settings)
            outcome.rows += batch.rows(highest, method.key, answer)
            for index in (0, len(batch.members) - 1):
                outcome.examples.append(batch.example(highest, method.key, answer, index))


def default_method() -> Method:
    """The detector that `novelty detect` uses."""
    return next(method for method in OURS if method.config == Config())


def _with_fewer_maps(experiment: Experiment, most: int | None) -> Experiment:
    cases = experiment.cases
    if most is None or most >= len(cases):
        return experiment
    places = [round(place * (len(cases) - 1) / (most - 1)) for place in range(most)]
    return replace(experiment, cases=tuple(cases[place] for place in places))
