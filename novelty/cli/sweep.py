"""`novelty sweep`: every pair under every configuration of a sweep, batched, stored as rows, resumable."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from novelty.cli.terminal import command_line, err, out, plain_table, working

if TYPE_CHECKING:
    from novelty.sweep.progress import Progress
    from novelty.sweep.run import Plan, Summary

SOME_FAILED = 1
"""Exit code when some runs have no answer."""

INTERRUPTED = 130
"""Exit code after Ctrl-C."""

UNITS = {"KB": 1e3, "MB": 1e6, "GB": 1e9}


def sweep(
    file: Annotated[
        Path, typer.Argument(metavar="SWEEP.yaml", help="Data and grid, or kmax, robustness, mosd or scale.")
    ],
    changes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[KEY=VALUE]...", help="Changes of the file, such as grid.max_components=[8,20]."
        ),
    ] = None,
    *,
    out_folder: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="Where the rows are; give the same again to continue."),
    ],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done, and stop.")] = False,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Try the runs again that failed.")
    ] = False,
    workers: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Processes; 0: this one. By default one per core.")
    ] = None,
    memory: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Budget of all workers of a machine, such as 8GB.")
    ] = None,
    executor: Annotated[str, typer.Option(metavar="local|ray", help="Where the workers are.")] = "local",
    address: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a Ray cluster; by default one on this machine.")
    ] = None,
) -> None:
    """Run a sweep; what is finished is never run again."""
    if executor not in ("local", "ray"):
        raise typer.BadParameter(f"expected local or ray, got {executor!r}", param_hint="--executor")
    with working("Starting"):
        from novelty.sweep.run import RunOptions, make_plan, run_sweep
        from novelty.sweep.sweep import load_sweep

        options = RunOptions(
            executor=executor,  # type: ignore[arg-type]
            workers=workers,
            address=address,
            memory=None if memory is None else _bytes(memory),
            retry_failed=retry_failed,
        )
        description = load_sweep(file, changes or [])
        plan = make_plan(description, options)
    if dry_run:
        _show_plan(plan)
        return
    with _stop_request() as stopping:
        summary = run_sweep(
            description, out_folder, options, _progress(plan), stopping, command=command_line(), plan=plan
        )
    _show_summary(summary, out_folder)
    if summary.left:
        raise typer.Exit(INTERRUPTED)
    if summary.failed or summary.failed_before:
        raise typer.Exit(SOME_FAILED)


def _bytes(text: str) -> float:
    """A size such as 8GB or 500MB."""
    number, unit = text[:-2], text[-2:].upper()
    try:
        return float(number) * UNITS[unit]
    except (KeyError, ValueError):
        raise typer.BadParameter(
            f"expected a size such as 8GB, got {text!r}", param_hint="--memory"
        ) from None


def _progress(plan: Plan) -> Progress:
    from novelty.sweep.progress import LineProgress, LiveProgress

    if err.is_terminal:
        return LiveProgress(len(plan.settings), err)
    return LineProgress(len(plan.settings), lambda line: err.print(escape(line), soft_wrap=True))


@contextmanager
def _stop_request() -> Iterator[Any]:
    """Ctrl-C and SIGTERM ask to stop after the batches that are being computed; a second one stops at once."""
    asked = False

    def ask(number: int, _frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        err.print("Stopping when the current batches are done; once more to stop at once and lose them.")

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: asked
    except KeyboardInterrupt:
        err.print(f"Stopped. To continue: {escape(command_line())}", soft_wrap=True)
        raise typer.Exit(INTERRUPTED) from None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _show_plan(plan: Plan) -> None:
    from novelty.sweep.estimate import SOURCE

    table = plain_table()
    table.add_column("plan")
    table.add_column("", justify="right")
    batches = plan.batches
    runs = [batch.num_runs for batch in batches]
    for name, value in (
        ("pairs", f"{len(plan.pairs)}"),
        ("settings", f"{len(plan.settings)}"),
        ("runs", f"{plan.num_runs}"),
        ("batches", f"{len(batches)}"),
        ("runs per batch", _range(runs)),
        ("batches at once", f"{plan.seats}"),
        ("time, about", _duration(plan.seconds)),
        ("memory, about", f"{plan.memory / 1e9:.1f} GB"),
    ):
        table.add_row(name, value)
    out.print(table)
    out.print(f"Estimated from the points of the first pairs: {SOURCE}")


def _show_summary(summary: Summary, folder: Path) -> None:
    for shard in summary.damaged:
        err.print(
            f"[yellow]damaged:[/] {escape(str(shard))} was set aside; its runs were computed again.",
            soft_wrap=True,
        )
    earlier = f"{summary.finished_before} {'was' if summary.finished_before == 1 else 'were'}"
    out.print(
        f"{_runs(summary.computed)} in {_duration(summary.seconds)}, {summary.failed} of them failed; "
        f"{earlier} done before. Rows: {escape(str(folder / 'rows'))}",
        soft_wrap=True,
    )
    if summary.failed or summary.failed_before:
        err.print(
            f"{_runs(summary.failed + summary.failed_before, 'has', 'have')} no answer; the column `message` says why. "
            "--retry-failed tries again.",
            soft_wrap=True,
        )
    if summary.left:
        err.print(
            f"{_runs(summary.left, 'is', 'are')} left. To continue: {escape(command_line())}", soft_wrap=True
        )


def _range(counts: Sequence[int]) -> str:
    least, most = min(counts, default=0), max(counts, default=0)
    return f"{least}" if least == most else f"{least} to {most}"


def _runs(count: int, one: str = "", many: str = "") -> str:
    """Runs and what they do, in the right number: "1 run has", "2 runs have"."""
    return f"1 run {one}".strip() if count == 1 else f"{count} runs {many}".strip()


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
