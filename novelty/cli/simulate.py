"""`novelty simulate`: labelled pairs of simulated scans, ready for `novelty evaluate`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from novelty.cli.terminal import out, working
from novelty.errors import InputError

if TYPE_CHECKING:
    from novelty.simulation import Experiment


def simulate(
    *,
    experiment: Annotated[
        str | None,
        typer.Argument(metavar="EXPERIMENT", help="Name or YAML file; without it, pairs of one scene."),
    ] = None,
    out_folder: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the pairs are written.")],
    scene: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Place (corridor); an unknown name lists those there are."),
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option("--change", metavar="NAME", help="What changes (person, box); repeatable."),
    ] = None,
    sensor: Annotated[
        str | None, typer.Option(metavar="NAME", help="Sensor (utm_30lx), such as vlp_16 or kinect.")
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(metavar="M", min=0, help="Range noise in metres instead of the sensor's own."),
    ] = None,
    count: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Number of pairs; of an experiment, per case.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Seed of the first pair; the next take the next.")
    ] = None,
) -> None:
    """Write simulated pairs with ground truth, and their pairs.csv: those of an experiment, or of one scene."""
    with working("Starting"):
        from novelty.simulation import load_experiment
        from novelty.simulation.dataset import write_dataset

    of_a_scene = {"scene": scene, "changes": changes, "sensor": sensor, "noise": noise}
    given = {key: value for key, value in of_a_scene.items() if value is not None}
    if experiment is not None and given:
        raise InputError(f"An experiment says itself what its {', '.join(given)} is; leave the option out.")
    plan = _one_scene(given) if experiment is None else load_experiment(experiment)
    pairs = replace(
        plan, repetitions=count or plan.repetitions, seed=plan.seed if seed is None else seed
    ).pairs()
    written = write_dataset(pairs, out_folder)
    for number in range(len(pairs) + 1):
        with working(f"Simulating pair {min(number + 1, len(pairs))} of {len(pairs)}"):
            next(written, None)
    listed = escape(str(out_folder / "pairs.csv"))
    out.print(f"{len(pairs)} {'pair' if len(pairs) == 1 else 'pairs'}: {listed}", soft_wrap=True)


def _one_scene(given: Mapping[str, object]) -> Experiment:
    """An experiment of one case, made of the options."""
    from novelty.simulation import Case, Experiment, Setup
    from novelty.simulation.experiments.setup import validated

    setup = validated(Setup, {"scene": "corridor", "changes": ("person", "box"), **given}, "novelty simulate")
    return Experiment(
        name=setup.scene,
        title="",
        source="",
        repetitions=1,
        seed=0,
        cases=(Case(setup.scene, {}, setup),),
        detectors=(),
        analyses=(),
    )
