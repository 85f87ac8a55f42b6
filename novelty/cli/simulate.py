"""`novelty simulate`: labelled pairs of simulated scans, ready for `novelty evaluate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from novelty.cli.terminal import out, working

if TYPE_CHECKING:
    from novelty.scan import Scan, ScanPair


def simulate(
    *,
    out_folder: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the pairs are written.")],
    scene: Annotated[
        str, typer.Option(metavar="NAME", help="Place; an unknown name lists those there are.")
    ] = "corridor",
    changes: Annotated[
        list[str] | None,
        typer.Option("--change", metavar="NAME", help="What changes (person, box, door, ...); repeatable."),
    ] = None,
    count: Annotated[int, typer.Option(metavar="N", min=1, help="Number of pairs.")] = 1,
    seed: Annotated[
        int, typer.Option(metavar="N", help="Seed of the first pair; the next take the next.")
    ] = 0,
    sensor: Annotated[
        str, typer.Option(metavar="NAME", help="Sensor, such as utm_30lx or vlp_16.")
    ] = "utm_30lx",
    noise: Annotated[
        float | None,
        typer.Option(metavar="M", min=0, help="Range noise in metres instead of the sensor's own."),
    ] = None,
) -> None:
    """Write simulated pairs with ground truth, and their pairs.csv."""
    with working("Starting"):
        from novelty.io import write_text
        from novelty.simulation import simulate_pair

    chosen = ("person", "box") if changes is None else tuple(changes)
    options: dict[str, Any] = {"sensor": sensor, "noise": noise}
    lines = ["name,reference,current,reference_origin,current_origin"]
    for number in range(seed, seed + count):
        with working(f"Simulating pair {number - seed + 1} of {count}"):
            pair = simulate_pair(scene, number, chosen, **options).scans
            lines.append(_write_pair(out_folder, pair))
    write_text(out_folder / "pairs.csv", "\n".join(lines) + "\n")
    out.print(
        f"{count} {'pair' if count == 1 else 'pairs'}: {escape(str(out_folder / 'pairs.csv'))}",
        soft_wrap=True,
    )


def _write_pair(folder: Path, pair: ScanPair) -> str:
    """Write both scans; returns their line of the manifest."""
    from novelty.io import write_ply

    cells = [pair.name]
    for role, scan in (("reference", pair.reference), ("current", pair.current)):
        path = Path(pair.name) / f"{role}.ply"
        labels = {} if scan.labels is None else {"label": scan.labels}
        write_ply(folder / path, scan.points, **labels)
        cells.append(path.as_posix())
    return ",".join([*cells, _origin(pair.reference), _origin(pair.current)])


def _origin(scan: Scan) -> str:
    """The origin as `x y z`; empty for a moving sensor, which a manifest cannot hold."""
    if scan.origin is None or scan.origin.ndim != 1:
        return ""
    return " ".join(f"{value:.6g}" for value in scan.origin)
