"""A folder of scans with poses, as pairs of consecutive scans: KITTI odometry, or any sensor with a trajectory."""

from __future__ import annotations

from pathlib import Path

from novelty.errors import InputError
from novelty.io.pair_entry import PairEntry
from novelty.io.poses import Poses, number_of, scans_like
from novelty.io.reading import READERS

POSES = "poses.txt"
"""The file of poses that is looked for in the folder and in the one above."""


def read_sequence(
    folder: str | Path, poses: str | Path | None = None, step: int = 1
) -> tuple[PairEntry, ...]:
    """Pair every scan of a folder with the one `step` later; no scan is read yet.

    Args:
        folder: Holds the scans, named by number or time; or holds one folder that does (KITTI's `velodyne`).
        poses: File of poses, see `Poses`; None looks for `poses.txt` in the folder and above, then for KITTI's
            `poses/NN.txt` beside `sequences/NN`.
        step: Scans from the reference to the current one.

    Raises:
        InputError: There are no scans or no poses, or a scan has no pose.
    """
    place = Path(folder)
    scans = _find_scans(place)
    file = Path(poses) if poses is not None else _find_poses(place)
    if not 1 <= step < len(scans):
        raise InputError(
            f"{place}: expected a step from 1 to {len(scans) - 1} between the {len(scans)} scans of a pair; got {step}."
        )
    known = Poses.read(file)
    for scan in scans:
        known.of(scan)
    return tuple(
        PairEntry(f"{before.stem}-{now.stem}", before, now, poses=file, source=str(place))
        for before, now in zip(scans, scans[step:], strict=False)
    )


def _find_scans(folder: Path) -> list[Path]:
    """The scans in a folder, or in the only folder beneath it that has some, in their order.

    Raises:
        InputError: There are none, or of several kinds or folders.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of scans; there is none.")
    groups = _groups(folder)
    if not groups:
        groups = [group for entry in sorted(folder.iterdir()) if entry.is_dir() for group in _groups(entry)]
    if not groups:
        raise InputError(
            f"{folder}: expected scans whose names end in a number ({', '.join(READERS)}); found none."
        )
    if len(groups) > 1:
        found = ", ".join(f"{len(group)} like {group[0].relative_to(folder)}" for group in groups)
        raise InputError(
            f"{folder}: expected scans of one kind; found {found}. Name the folder that holds one kind."
        )
    return groups[0]


def _groups(folder: Path) -> list[list[Path]]:
    """The numbered scans directly in a folder, by their extension."""
    suffixes = {
        entry.suffix: entry
        for entry in folder.iterdir()
        if entry.suffix.lower() in READERS and number_of(entry) is not None
    }
    return [list(scans_like(suffixes[suffix])) for suffix in sorted(suffixes)]


def _find_poses(folder: Path) -> Path:
    places = (
        folder / POSES,
        folder.parent / POSES,
        folder.parent.parent / "poses" / f"{folder.name}.txt",
        folder.parent.parent.parent / "poses" / f"{folder.parent.name}.txt",
    )
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise InputError(
            f"{folder}: expected the poses of the scans in {POSES}, in the folder or above it; found none. "
            "Without poses, list the pairs in a pairs.csv."
        )
    return found
