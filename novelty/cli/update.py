"""`novelty update`: a map brought up to date by a new scan of its place."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from novelty.cli.fit import show_map
from novelty.cli.options import (
    DETECTORS,
    Assignments,
    ConfigFile,
    CurrentOrigin,
    Unit,
    build_map_config,
    parse_origin,
)
from novelty.cli.terminal import out, working


def update(
    file: Annotated[Path, typer.Argument(metavar="MAP", help="Map made by `novelty fit`.")],
    current: Annotated[Path, typer.Argument(metavar="CUR", help="Scan of the place as it is now.")],
    *,
    out_file: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Where the new map is written; default: in place of MAP."),
    ] = None,
    config: ConfigFile = None,
    detector: Annotated[str | None, typer.Option(metavar="NAME", help=f"{DETECTORS}.")] = None,
    assignments: Assignments = None,
    unit: Unit = None,
    current_origin: CurrentOrigin = None,
) -> None:
    """Take what is new into a map and forget what has gone.

    Only what the scan saw to be gone is forgotten, which needs the place of its sensor; what is out of sight stays.
    """
    origin = parse_origin(current_origin, "--current-origin")
    with working("Starting"):
        from novelty.cli.answer import show_answer
        from novelty.io import read_scan
        from novelty.maps import SceneMap, check_replaceable
        from novelty.maps import update as update_map

        if out_file is not None:
            check_replaceable(out_file)
        scene_map = SceneMap.load(file)
        settings = build_map_config(scene_map, config, assignments, detector=detector, unit=unit)
    with working("Reading the scan"):
        scan = read_scan(current, origin)
    with working("Comparing and refining"):
        updated = update_map(scene_map, scan, settings)
        target = file if out_file is None else out_file
        updated.scene_map.save(target)
    show_answer(updated.result, settings.unit, {})
    if updated.note:
        out.print(f"[yellow]note:[/] {escape(updated.note)}")
    show_map(updated.scene_map, target)
    out.print(
        f"cells: {updated.cells_added} added, {updated.cells_refined} refined, {updated.cells_forgotten} forgotten"
    )
