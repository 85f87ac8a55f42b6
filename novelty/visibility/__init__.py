"""What the other scan could see."""

from novelty.visibility.patches import filled_between_lines
from novelty.visibility.rays import Rays, Sight, has_stations, joint_sights, stations_of
from novelty.visibility.verdict import Visibility, blind_notes, judge

__all__ = [
    "Rays",
    "Sight",
    "Visibility",
    "blind_notes",
    "filled_between_lines",
    "has_stations",
    "joint_sights",
    "judge",
    "stations_of",
]
