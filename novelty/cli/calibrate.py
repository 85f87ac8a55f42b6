"""`novelty calibrate`: a detector's parameters from labelled pairs, and what they gain on held-out ones."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from novelty.cli.options import (
    DETECTORS,
    Assignments,
    ConfigFile,
    MaxComponents,
    Preset,
    Seed,
    Unit,
    build_config,
)
from novelty.cli.terminal import command_line, out, plain_table, working
from novelty.errors import InputError

if TYPE_CHECKING:
    from novelty.calibration import Calibration, FittedPair
    from novelty.config import Config
    from novelty.io import FailedPair, PairEntry


NOTHING_GAINED = "Nothing gained: these are the settings as they were given. "


def calibrate(
    pairs: Annotated[
        Path, typer.Argument(metavar="PAIRS.csv", help="Manifest of pairs whose scans carry labels.")
    ],
    *,
    out_file: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="Where the settings are written, for --config.")
    ],
    detector: Annotated[str | None, typer.Option(metavar="NAME", help=f"{DETECTORS}.")] = None,
    folds: Annotated[
        int | None,
        typer.Option(metavar="N", help="Folds of the cross-validation; one per pair, ten at most."),
    ] = None,
    preset: Preset = None,
    config: ConfigFile = None,
    assignments: Assignments = None,
    unit: Unit = None,
    max_components: MaxComponents = None,
    seed: Seed = None,
) -> None:
    """Choose a detector's parameters on labelled pairs.

    Where they gain nothing on held-out pairs, the settings are written as they were given.
    """
    with working("Starting"):
        from novelty.calibration import calibrate as choose
        from novelty.config_yaml import changed_yaml
        from novelty.io import read_entries, refuse_overwriting, write_text

        refuse_overwriting([out_file], [pairs], "choose another name")
        settings = build_config(
            config,
            assignments,
            preset,
            detector=detector,
            unit=unit,
            max_components=max_components,
            seed=seed,
        )
        entries = read_entries(pairs)
    fitted = []
    for number, entry in enumerate(entries):
        with working(f"Fitting pair {number + 1} of {len(entries)}"):
            fitted.append(_fit(entry, settings))
    with working("Comparing"):
        found = choose(fitted, settings, folds)
    _show(found, settings)
    kept = settings.replace(**found.settings) if found.gained else settings
    write_text(out_file, changed_yaml(kept, _header(found, settings)))
    if not found.gained:
        out.print("[yellow]Nothing gained: the settings stay as given.[/]")
    out.print(f"Settings: {escape(str(out_file))}", soft_wrap=True)


def _fit(entry: PairEntry | FailedPair, config: Config) -> FittedPair:
    """Load and fit one pair; unlike an evaluation, a calibration does not go on without some of its pairs.

    Raises:
        InputError: The pair cannot be used.
    """
    from novelty.calibration import fit_pair
    from novelty.io import FailedPair

    if isinstance(entry, FailedPair):
        raise entry.error
    pair = entry.load()
    try:
        return fit_pair(pair, config.replace(unit=entry.unit) if entry.unit else config)
    except InputError as error:
        raise InputError(f"{entry.source}: {error}") from None


def _show(found: Calibration, config: Config) -> None:
    """Print one row per held-out pair, the gain, and what was chosen."""
    table = plain_table()
    for heading in (f"{config.detector}: kappa of held-out pairs", "as given", "calibrated"):
        table.add_column(heading, justify="left" if heading.startswith(config.detector) else "right")
    for name, before, after in zip(found.names, found.before, found.after, strict=True):
        table.add_row(escape(name), f"{before:.3f}", f"{after:.3f}")
    table.add_section()
    table.add_row("mean", *(f"{_mean(values):.3f}" for values in (found.before, found.after)), style="bold")
    out.print(table)
    out.print(f"Gain on held-out pairs: {_gain(found)}")
    given = config.to_mapping()
    for key, value in found.settings.items():
        section, name = key.split(".")
        out.print(f"  {key}: {_short(value)} (was {_short(given[section][name])})")
    for note in found.notes:
        out.print(f"Note: {escape(note)}")


def _mean(values: object) -> float:
    from novelty.evaluation import bootstrap_interval

    return bootstrap_interval(values).mean  # type: ignore[arg-type]


def _gain(found: Calibration) -> str:
    gain = found.gain
    return f"{gain.mean:+.3f}, 95 % interval [{gain.low:+.3f}, {gain.high:+.3f}], {gain.count} pairs"


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _header(found: Calibration, config: Config) -> str:
    return (
        f"# Written by `{command_line()}`.\n"
        f"# {config.detector} on {len(found.names)} pairs, {found.folds.max() + 1} folds: mean kappa of held-out pairs "
        f"{_mean(found.before):.3f} before, {_mean(found.after):.3f} after.\n"
        f"# Gain {_gain(found)}. {'' if found.gained else NOTHING_GAINED}Keys that are not here keep their defaults.\n"
    )
