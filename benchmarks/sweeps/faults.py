"""Point 5: a full disk, an unreadable scan, a scan that takes all memory, a damaged shard: what the user sees."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import yaml

from benchmarks.sweeps.commands import SWEEPS, say, show_command
from benchmarks.sweeps.rows import written_pairs
from novelty.sweep import read_rows


def point_5(folder: Path, small: bool) -> None:
    """What goes wrong, and what the user sees."""
    manifest = written_pairs(folder / "scans", 3, 5_000)
    lines = manifest.read_text().splitlines()
    (folder / "scans" / "torn.ply").write_bytes((folder / "scans" / "0-reference.ply").read_bytes()[:3000])
    huge = np.lib.format.open_memmap(
        folder / "scans" / "huge.npy", mode="w+", dtype="f4", shape=(60_000_000, 3)
    )
    huge[:: len(huge) // 1000] = np.random.default_rng(0).normal(size=huge[:: len(huge) // 1000].shape)
    del huge
    lines += ["torn,torn.ply,0-current.ply,,", "huge,huge.npy,0-current.ply,,"]
    manifest.write_text("\n".join(lines))
    file = folder / "faults.yaml"
    file.write_text(
        yaml.safe_dump({"data": {"files": {"pairs": str(manifest)}}, "grid": {"max_components": [5, 10]}})
    )
    say("--- an unreadable scan, and one that takes all memory (budget 3 GB for two workers)")
    show_command(file, folder / "faults", "--memory", "3GB")
    rows = read_rows(folder / "faults").to_pandas()
    for row in rows[rows.status.isin(["failed", "out of memory"])].drop_duplicates("pair").itertuples():
        say(f"row of {row.pair}: {row.status}: {row.message[:150]}")
    say("--- a damaged shard")
    shard = sorted((folder / "faults" / "rows").iterdir())[0]
    shard.write_bytes(shard.read_bytes()[:2000])
    show_command(file, folder / "faults", "--memory", "3GB")
    say("--- a disk that fills up")
    with full_disk(folder / "disk", "150k") as disk:
        if disk is None:
            say("skipped: mounting a small disk needs root")
            return
        small_sweep = SWEEPS / "scale.yaml"
        show_command(small_sweep, disk / "out", "data.rooms.count=96", "grid.max_components=[5,10]")
        safe = len(read_rows(disk / "out"))
        subprocess.run(["mount", "-o", "remount,size=100m", str(disk)], check=True)
        say(f"{safe} rows are safe; after making room:")
        show_command(small_sweep, disk / "out", "data.rooms.count=96", "grid.max_components=[5,10]")
        say(f"{len(read_rows(disk / 'out'))} rows")


class full_disk:  # noqa: N801
    """A file system of its own of so many bytes; None where that needs rights that one does not have."""

    def __init__(self, place: Path, size: str) -> None:
        self.place, self.size = place, size

    def __enter__(self) -> Path | None:
        self.place.mkdir(parents=True)
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={self.size}", "tmpfs", str(self.place)],
            capture_output=True,
            check=False,
        )
        self.mounted = done.returncode == 0
        return self.place if self.mounted else None

    def __exit__(self, *_: object) -> None:
        if self.mounted:
            subprocess.run(["umount", str(self.place)], check=True)
