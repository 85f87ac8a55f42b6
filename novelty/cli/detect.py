"""`novelty detect`: what is new and what is gone between two scans."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from novelty.cli.options import (
    DETECTORS,
    Assignments,
    ConfigFile,
    CurrentOrigin,
    MaxComponents,
    Preset,
    Seed,
    Unit,
    build_config,
    build_map_config,
    parse_origin,
)
from novelty.cli.terminal import command_line, out, working

if TYPE_CHECKING:
    from novelty.maps import SceneMap

CHANGED = 3
"""Exit code of `--fail-on-change` when something changed."""


def detect(
    reference: Annotated[
        Path, typer.Argument(metavar="REF", help="Scan of the place as it was, or a map of it.")
    ],
    current: Annotated[Path, typer.Argument(metavar="CUR", help="Scan of the place as it is now.")],
    *,
    out_folder: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="Write result.json, both scans with labels, and report.html."
        ),
    ] = None,
    preset: Preset = None,
    config: ConfigFile = None,
    detector: Annotated[str | None, typer.Option(metavar="NAME", help=f"{DETECTORS}.")] = None,
    assignments: Assignments = None,
    unit: Unit = None,
    reference_origin: Annotated[
        str | None, typer.Option(metavar='"X Y Z"', help="Where the sensor stood for the reference scan.")
    ] = None,
    current_origin: CurrentOrigin = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Poses of the sequence both scans belong to (KITTI or TUM); bring them together.",
        ),
    ] = None,
    max_components: MaxComponents = None,
    seed: Seed = None,
    fail_on_change: Annotated[
        bool, typer.Option("--fail-on-change", help=f"Exit with code {CHANGED} when something changed.")
    ] = False,
) -> None:
    """Say what is new and what is gone between two scans.

    REF may be a map made by `novelty fit`; reference.ply then holds its cells. In a file of several scans, # names
    one: survey.e57#2, drive.bag#/points:120.
    """
    origin_before = parse_origin(reference_origin, "--reference-origin")
    origin_now = parse_origin(current_origin, "--current-origin")
    with working("Starting"):
        from novelty.cli.answer import show_answer
        from novelty.cli.scoring import score_result
        from novelty.io import read_scan
        from novelty.maps import detect_against
        from novelty.pipeline import detect as detect_pair
        from novelty.report import Run, check_folder, make_folder, write_outputs
        from novelty.scan import ScanPair

        if out_folder is not None:
            check_folder(out_folder, (reference, current))
        scene_map = _map(reference, reference_origin)
        given = {"detector": detector, "unit": unit, "max_components": max_components, "seed": seed}
        if scene_map is None:
            settings = build_config(config, assignments, preset, **given)
        else:
            settings = build_map_config(scene_map, config, assignments, preset, **given)
        if out_folder is not None:
            make_folder(out_folder)
    with working("Reading the scans"):
        pair = ScanPair(
            reference=scene_map.as_scan() if scene_map else read_scan(reference, origin_before, poses),
            current=read_scan(current, origin_now, poses),
            name=_pair_name(reference, current),
        )
    with working("Comparing"):
        if scene_map is None:
            result = detect_pair(pair, settings)
        else:
            result = replace(detect_against(scene_map, pair.current, settings), name=pair.name)
        scores = score_result(pair, result)
    show_answer(result, settings.unit, scores)
    if out_folder is not None:
        with working(f"Writing {out_folder}"):
            write_outputs(out_folder, pair, result, Run(settings.to_mapping(), command_line()), scores)
        out.print(f"\nReport: {escape(str(out_folder / 'report.html'))}", soft_wrap=True)
    if fail_on_change and result.changed:
        raise typer.Exit(CHANGED)


def _map(file: Path, origin: str | None) -> SceneMap | None:
    """The map in a file; None for a scan, or what is to be read as one."""
    from novelty.maps import SceneMap, is_map

    if not is_map(file):
        return None
    if origin is not None:
        raise typer.BadParameter(f"{file} is a map, which knows its origins", param_hint="--reference-origin")
    return SceneMap.load(file)


def _pair_name(reference: Path, current: Path) -> str:
    """The files by their own names and those of their folders: "monday/scan → tuesday/scan"."""
    short = (str(Path(*path.resolve().parts[-2:]).with_suffix("")) for path in (reference, current))
    return " → ".join(short)
