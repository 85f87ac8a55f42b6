"""One pair of scans that is yet to be read: where its files are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from novelty.errors import InputError
from novelty.io.address import ScanAddress
from novelty.io.poses import Poses
from novelty.io.reading import read_scan
from novelty.scan import ScanPair


@dataclass(frozen=True)
class PairEntry:
    """One line of a manifest, or two scans of a sequence: where the scans of a pair are.

    Attributes:
        name: Unique in the manifest.
        reference: The reference scan, as `read_scan` takes it.
        current: The current scan.
        reference_origin: Where the sensor stood, (x, y, z); None takes what the file says.
        current_origin: The same for the current scan.
        unit: Unit of the coordinates; None when the manifest does not say.
        source: The manifest and the line, for messages.
        poses: File of the poses that bring both scans into one frame; None when they are in one.
    """

    name: str
    reference: Path
    current: Path
    reference_origin: tuple[float, float, float] | None = None
    current_origin: tuple[float, float, float] | None = None
    unit: str | None = None
    source: str = ""
    poses: Path | None = None

    def load(self) -> ScanPair:
        """Read both scans.

        Raises:
            InputError: A scan cannot be read; the message names the line of the manifest.
            MissingDependencyError: A library that a format needs cannot be loaded.
        """
        try:
            poses = None if self.poses is None else Poses.read(self.poses)
            reference = read_scan(self.reference, self.reference_origin, poses)
            current = read_scan(self.current, self.current_origin, poses)
        except InputError as error:
            raise InputError(f"{self.source}: {error}" if self.source else str(error)) from error
        return ScanPair(reference, current, self.name)

    def files(self) -> tuple[Path, ...]:
        """Every file that `load` reads points or poses from, in a repeatable order."""
        scans = (*ScanAddress.parse(self.reference).files(), *ScanAddress.parse(self.current).files())
        return scans if self.poses is None else (*scans, self.poses)
