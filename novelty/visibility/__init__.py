"""What the other scan could see."""

from novelty.visibility.rays import Rays, Sight, joint_sights, stations_of
from novelty.visibility.verdict import Visibility, blind_notes, judge

__all__ = ["Rays", "Sight", "Visibility", "blind_notes", "joint_sights", "judge", "stations_of"]
