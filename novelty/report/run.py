"""How a result came about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Run:
    """What a reader must know to make a result again.

    Attributes:
        settings: The configuration, as `Config.to_mapping` gives it.
        command: The command that was typed; empty when there was none.
    """

    settings: Mapping[str, Any]
    command: str = ""

    @property
    def unit(self) -> str:
        """Unit of the scans' coordinates."""
        return str(self.settings["unit"])
