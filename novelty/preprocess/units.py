"""Units of length in which scans are given."""

from __future__ import annotations

from novelty.errors import ConfigError

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Length of each unit, m."""


def metres_per(unit: str) -> float:
    """Length of `unit`, m.

    Raises:
        ConfigError: The unit is not in the table.
    """
    try:
        return METRES[unit]
    except KeyError:
        raise ConfigError(f"unit must be one of {', '.join(METRES)}; got {unit!r}.") from None
