"""`novelty sweep` as a process: started, waited for, shown."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

SWEEPS = Path(__file__).parents[2] / "configs" / "sweeps"


def command(file: Path | str, out: Path, *rest: str) -> list[str]:
    return [
        sys.executable,
        "-c",
        "from novelty.cli import main; main()",
        "sweep",
        str(file),
        "--out",
        str(out),
        *rest,
    ]


def start_command(out: Path, rest: list[str]) -> subprocess.Popen:
    """scale.yaml in a process group of its own, so that a kill takes its workers too."""
    with (out.parent / f"{out.name}.log").open("a") as log:
        return subprocess.Popen(
            command(SWEEPS / "scale.yaml", out, *rest), start_new_session=True, stdout=log, stderr=log
        )


def run_command(out: Path, rest: list[str]) -> None:
    if start_command(out, rest).wait() not in (0, 1):
        raise SystemExit((out.parent / f"{out.name}.log").read_text())


def show_command(file: Path | str, out: Path, *rest: str) -> None:
    """Run a sweep and show what the user sees."""
    done = subprocess.run(command(file, out, *rest), capture_output=True, text=True, check=False)
    for line in (done.stdout + done.stderr).splitlines():
        say(f"  | {line}")
    say(f"  | exit code {done.returncode}")


def rows_in(root: Path) -> int:
    """Rows in the shards of a folder, read or not."""
    return sum(pq.read_metadata(shard).num_rows for shard in (root / "rows").glob("[!.]*.parquet"))


def wait_for(condition: Callable[[], Any], seconds: float = 120.0) -> Any:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if found := condition():
            return found
        time.sleep(0.05)
    raise TimeoutError("nothing happened")


def say(line: str) -> None:
    print(line, flush=True)
