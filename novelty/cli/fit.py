"""`novelty fit`: a map of a place, to compare later scans with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from novelty.cli.options import (
    Assignments,
    ConfigFile,
    MaxComponents,
    Preset,
    Seed,
    Unit,
    build_config,
    parse_origin,
)
from novelty.cli.terminal import out, working

if TYPE_CHECKING:
    from novelty.maps import SceneMap


def fit(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="Scan of the place.")],
    *,
    out_file: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="Where the map is written; ends in .safetensors.")
    ],
    preset: Preset = None,
    config: ConfigFile = None,
    assignments: Assignments = None,
    unit: Unit = None,
    origin: Annotated[str | None, typer.Option(metavar='"X Y Z"', help="Where the sensor stood.")] = None,
    max_components: MaxComponents = None,
    seed: Seed = None,
) -> None:
    """Make a map of a place from a scan, for `novelty detect MAP CUR`."""
    place = parse_origin(origin, "--origin")
    with working("Starting"):
        from novelty.io import read_scan
        from novelty.maps import check_replaceable
        from novelty.maps import fit as fit_scan

        check_replaceable(out_file)
        settings = build_config(
            config, assignments, preset, unit=unit, max_components=max_components, seed=seed
        )
    with working("Reading the scan"):
        read = read_scan(scan, place)
    with working("Fitting"):
        scene_map = fit_scan(read, settings)
        scene_map.save(out_file)
    show_map(scene_map, out_file)
    if not scene_map.views:
        out.print(
            "[yellow]note:[/] the place of the sensor is not known, so what it could not see may be called novel "
            "later; give --origin."
        )


def show_map(scene_map: SceneMap, file: Path) -> None:
    """Print what a map holds and how large its file is."""
    components = int(scene_map.model.mixtures.num_components[0])
    scans = f"{scene_map.num_scans} scan{'s' if scene_map.num_scans > 1 else ''}"
    out.print(f"[bold]Map: {escape(str(file))}, {file.stat().st_size / 1000:.0f} kB[/]", soft_wrap=True)
    out.print(
        f"{_spaced(len(scene_map))} cells of {_spaced(scene_map.num_points)} points, {components} components, "
        f"from {scans}"
    )


def _spaced(number: int) -> str:
    return f"{number:,}".replace(",", " ")
