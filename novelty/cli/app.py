"""The commands of `novelty`, and what an error of theirs looks like to a person.

Only typer and rich are imported here and at the top of the commands' files, so that `novelty --help` answers
at once.
"""

from __future__ import annotations

import atexit
import gc
import os
from collections.abc import Sequence
from typing import Annotated

import typer

from novelty import __version__
from novelty.cli.calibrate import calibrate
from novelty.cli.demo import demo
from novelty.cli.detect import detect
from novelty.cli.doctor import doctor
from novelty.cli.evaluate import evaluate
from novelty.cli.fit import fit
from novelty.cli.paper import paper
from novelty.cli.report import report
from novelty.cli.simulate import simulate
from novelty.cli.sweep import sweep
from novelty.cli.terminal import complain
from novelty.cli.update import update
from novelty.errors import NoveltyError

BAD_INPUT = 2
"""Exit code of a wrong call, a wrong configuration and an input that cannot be used."""

app = typer.Typer(
    name="novelty",
    help="What is new and what is gone between two laser scans of one place.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

for command in (detect, fit, update, evaluate, calibrate, demo, simulate, sweep, report, paper, doctor):
    app.command()(command)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"novelty {__version__}")
        raise typer.Exit


@app.callback()
def _options_of_every_command(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and stop."),
    ] = False,
) -> None:
    pass


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; `arguments` default to those of the process.

    Raises:
        SystemExit: Always, with the exit code.
    """
    # Idle threads that spin for long slow every program on a busy machine down, this one first; those that sleep at
    # once are late for the next of many short loops. Spinning for some 20 microseconds suits both; set before torch.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("GOMP_SPINCOUNT", "10000")
    _collect_garbage_seldom()
    try:
        app(args=arguments)
    except NoveltyError as error:
        complain(str(error))
        raise SystemExit(BAD_INPUT) from None


def _collect_garbage_seldom() -> None:
    """Spare the half million objects of imported libraries from being searched: 0.6 s of every command."""
    gc.set_threshold(100_000, 50, 50)
    atexit.register(gc.freeze)
