"""Timings of `make bench` (pytest-benchmark's JSON) as tables and as a page, with the peers beside us."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from novelty import __version__
from novelty.errors import InputError
from novelty.io import write_text
from novelty.report.rendering import render
from novelty.report.tables import Column, Row, Table, number, thousands

OURS = ("gmmtorch", "novelty")
"""Values of `extra_info.library` that are not peers."""


@dataclass(frozen=True)
class Timing:
    """One benchmark.

    Attributes:
        name: Of the test, with its parameters.
        group: Benchmarks of one group do the same work.
        library: What did the work; empty where there is no peer.
        median: Seconds.
        iqr: Interquartile range, seconds.
        rounds: How often it was run.
    """

    name: str
    group: str
    library: str
    median: float
    iqr: float
    rounds: int


@dataclass(frozen=True)
class Benchmarks:
    """The timings of one session and where they were taken."""

    timings: tuple[Timing, ...]
    machine: Mapping[str, str]

    @classmethod
    def read(cls, path: str | Path) -> Benchmarks:
        """Read what `pytest --benchmark-json` wrote.

        Raises:
            InputError: The file is missing, or something else.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            return cls(tuple(_timing(entry) for entry in content["benchmarks"]), _machine(content))
        except OSError as error:
            raise InputError(f"{path}: the file cannot be read: {error.strerror}.") from None
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{path}: expected the JSON of pytest-benchmark ({error}). `make bench` writes it to bench.json."
            ) from None


def benchmark_tables(benchmarks: Benchmarks) -> list[tuple[str, Table]]:
    """One table per group that has peers, by speed; then one of all the others."""
    groups: dict[str, list[Timing]] = {}
    for timing in benchmarks.timings:
        groups.setdefault(timing.group if timing.library else "", []).append(timing)
    alone = groups.pop("", [])
    tables = [(name, _peer_table(timings)) for name, timings in groups.items()]
    return [*tables, *([("Stages", _table(alone))] if alone else [])]


def write_benchmark_page(path: str | Path, benchmarks: Benchmarks) -> None:
    """Write a page of timings alone."""
    page = {
        "title": "How fast it is",
        "benchmarks": benchmark_tables(benchmarks),
        "machine": ", ".join(f"{name} {value}" for name, value in benchmarks.machine.items() if value),
        "version": __version__,
    }
    write_text(path, render("benchmarks.html.j2", {}, page=page))


def _peer_table(timings: Sequence[Timing]) -> Table:
    """Fastest first; the ratio is to the fastest of ours."""
    ours = [timing.median for timing in timings if timing.library in OURS]
    columns = (
        Column("library", numeric=False),
        Column("median [ms]"),
        Column("spread (IQR) [ms]"),
        Column("rounds"),
        Column("time relative to ours"),
    )
    rows = []
    for timing in sorted(timings, key=lambda timing: timing.median):
        ratio = f"{timing.median / min(ours):.2f} ×" if ours else "–"
        mark = "total" if timing.library in OURS else ""
        rows.append(Row((timing.library, *_figures(timing), ratio), mark))
    return Table(columns, tuple(rows))


def _table(timings: Sequence[Timing]) -> Table:
    columns = (
        Column("benchmark", numeric=False),
        Column("median [ms]"),
        Column("spread (IQR) [ms]"),
        Column("rounds"),
    )
    return Table(columns, tuple(Row((timing.name, *_figures(timing))) for timing in timings))


def _figures(timing: Timing) -> tuple[str, str, str]:
    spread = _milliseconds(timing.iqr) if timing.rounds > 1 else "–"
    return _milliseconds(timing.median), spread, str(timing.rounds)


def _milliseconds(seconds: float) -> str:
    return number(1e3 * seconds) if seconds < 1 else thousands(round(1e3 * seconds))


def _timing(entry: Mapping[str, Any]) -> Timing:
    stats = entry["stats"]
    name = str(entry["name"]).removeprefix("test_")
    library = str(entry.get("extra_info", {}).get("library", ""))
    return Timing(
        name, str(entry.get("group") or ""), library, stats["median"], stats["iqr"], stats["rounds"]
    )


def _machine(content: Mapping[str, Any]) -> dict[str, str]:
    info, commit = content.get("machine_info", {}), content.get("commit_info", {})
    processor = info.get("cpu", {})
    return {
        "processor": str(processor.get("brand_raw", info.get("processor", ""))),
        "cores": str(processor.get("count", "")),
        "Python": str(info.get("python_version", "")),
        "taken": str(content.get("datetime", ""))[:16],
        "commit": str(commit.get("id", ""))[:10],
    }
