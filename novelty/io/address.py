"""Where a scan lies: a file, and, in a file of several scans, which of them: `survey.e57#2`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

MARK = "#"
"""What separates the file from the scan in it."""


@dataclass(frozen=True)
class ScanAddress:
    """A file, or the folder of a ROS 2 bag, and the part of it that is meant; empty for the whole."""

    file: Path
    part: str = ""

    @classmethod
    def parse(cls, path: str | Path) -> ScanAddress:
        """Split at the first `#`, unless the whole is the name of something that exists."""
        text = str(path)
        name, mark, part = text.partition(MARK)
        if not mark or not name or Path(text).exists():
            return cls(Path(path))
        return cls(Path(name), part)

    def files(self) -> tuple[Path, ...]:
        """The files that hold the scan, in a repeatable order: one, or all those of a ROS 2 bag."""
        if self.file.is_dir():
            return tuple(sorted(entry for entry in self.file.iterdir() if entry.is_file()))
        return (self.file,)

    def __str__(self) -> str:
        return f"{self.file}{MARK}{self.part}" if self.part else str(self.file)
