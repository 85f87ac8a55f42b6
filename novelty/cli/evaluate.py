"""`novelty evaluate`: scores of one or more detectors on the pairs of a manifest."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
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
from novelty.cli.terminal import err, out, working
from novelty.errors import NoveltyError

if TYPE_CHECKING:
    from novelty.cli.scoring import ScoredPair
    from novelty.config import Config
    from novelty.io import FailedPair, PairEntry
    from novelty.result import NoveltyResult
    from novelty.scan import ScanPair

SOME_FAILED = 1
"""Exit code when some pairs have no scores."""

SUFFIXES = (".csv", ".json")

POINTS_PER_BATCH = 4_000_000
"""Points that are held in memory at once; more pairs than that are worked off in several batches."""


def evaluate(
    pairs: Annotated[
        Path, typer.Argument(metavar="PAIRS.csv", help="Manifest of pairs whose scans carry labels.")
    ],
    *,
    detectors: Annotated[
        list[str] | None, typer.Option("--detector", metavar="NAME", help=f"{DETECTORS}; repeatable.")
    ] = None,
    preset: Preset = None,
    config: ConfigFile = None,
    assignments: Assignments = None,
    unit: Unit = None,
    max_components: MaxComponents = None,
    seed: Seed = None,
    out_file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the rows to a .csv or .json file.")
    ] = None,
) -> None:
    """Score detectors on the pairs of a manifest."""
    if out_file is not None and out_file.suffix not in SUFFIXES:
        raise typer.BadParameter(f"expected a file ending in {' or '.join(SUFFIXES)}", param_hint="--out")
    with working("Starting"):
        from novelty.cli.rows import write_rows
        from novelty.io import read_entries, refuse_overwriting

        if out_file is not None:
            refuse_overwriting([out_file], [pairs], "choose another name")
        given = {"unit": unit, "max_components": max_components, "seed": seed}
        shared = build_config(config, assignments, preset, **given)
        configs = [shared.replace(detector=name) for name in dict.fromkeys(detectors or [shared.detector])]
        entries = read_entries(pairs)
    rows: list[ScoredPair] = []
    for batch in _batches(entries, configs[0].unit):
        for settings in configs:
            done = f"{len(rows)} of {len(entries) * len(configs)} pairs done"
            with working(f"{done}; {settings.detector} on the next {len(batch)}"):
                rows += _score_batch(batch, settings)
    for settings in configs:
        _show([row for row in rows if row.detector == settings.detector], settings.detector)
    for name, failure in dict.fromkeys((row.name, row.failure) for row in rows if row.failure):
        err.print(f"[bold red]{escape(name)} failed:[/] {escape(failure)}", soft_wrap=True)
    if out_file is not None:
        write_rows(out_file, rows)
        out.print(f"Rows: {escape(str(out_file))}", soft_wrap=True)
    if any(row.failure for row in rows):
        raise typer.Exit(SOME_FAILED)


@dataclass(frozen=True, eq=False)
class _Loaded:
    """A pair in memory and the unit of its coordinates, or the reason why it cannot be scored."""

    name: str
    unit: str
    pair: ScanPair | None
    failure: str = ""

    @property
    def num_points(self) -> int:
        return 0 if self.pair is None else self.pair.reference.num_points + self.pair.current.num_points


def _batches(entries: Iterable[PairEntry | FailedPair], unit: str) -> Iterator[list[_Loaded]]:
    """Load the pairs in their order, as many at a time as fit in memory."""
    batch: list[_Loaded] = []
    for entry in entries:
        batch.append(_load(entry, unit))
        if sum(loaded.num_points for loaded in batch) >= POINTS_PER_BATCH:
            yield batch
            batch = []
    if batch:
        yield batch


def _load(entry: PairEntry | FailedPair, unit: str) -> _Loaded:
    from novelty.io import FailedPair
    from novelty.preprocess.units import metres_per

    if isinstance(entry, FailedPair):
        return _Loaded(entry.name, unit, None, str(entry.error))
    unit = entry.unit or unit
    try:
        metres_per(unit)
        pair = entry.load()
    except NoveltyError as error:
        message = str(error)
        source = "" if message.startswith(entry.source) else f"{entry.source}: "
        return _Loaded(entry.name, unit, None, source + message)
    if pair.reference.labels is None and pair.current.labels is None:
        reason = f"{entry.source}: neither scan carries ground truth (a `label` per vertex)."
        return _Loaded(entry.name, unit, None, reason)
    return _Loaded(entry.name, unit, pair)


def _score_batch(batch: Sequence[_Loaded], config: Config) -> list[ScoredPair]:
    """One row per pair, in the order of the batch; the pairs of one unit are one call."""
    from novelty.pipeline import detect_many

    results: dict[int, NoveltyResult] = {}
    for unit in dict.fromkeys(loaded.unit for loaded in batch if loaded.pair is not None):
        places = [place for place, loaded in enumerate(batch) if loaded.pair and loaded.unit == unit]
        pairs = [pair for place in places if (pair := batch[place].pair)]
        results |= zip(places, detect_many(pairs, config.replace(unit=unit)), strict=True)
    return [_score(loaded, results.get(place), config.detector) for place, loaded in enumerate(batch)]


def _score(loaded: _Loaded, result: NoveltyResult | None, detector: str) -> ScoredPair:
    from novelty.cli.scoring import ScoredPair, score_result, scored_pair
    from novelty.result import ResultStatus

    if loaded.pair is None or result is None:
        return ScoredPair(loaded.name, detector, {}, loaded.failure)
    if result.status is ResultStatus.FAILED:
        return ScoredPair(loaded.name, detector, {}, result.message)
    return scored_pair(detector, result, score_result(loaded.pair, result))


def _show(rows: Sequence[ScoredPair], detector: str) -> None:
    from novelty.cli.scoring import cells, mean_row, score_table

    table = score_table(detector)
    for row in rows:
        # The pairs are computed together: only their mean time is known.
        values = {**row.values, "seconds": math.nan} if len(rows) > 1 else row.values
        table.add_row(escape(row.name), *(["[red]failed[/]"] if row.failure else cells(values)))
    scored = [row for row in rows if not row.failure]
    if scored:
        table.add_section()
        table.add_row(f"mean of {len(scored)}", *cells(mean_row(scored)), style="bold")
    out.print(table)
