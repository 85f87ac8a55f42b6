"""What the other scan could see."""

from novelty.visibility.rays import Rays, Sight
from novelty.visibility.verdict import Visibility, blind_notes, judge

__all__ = ["Rays", "Sight", "Visibility", "blind_notes", "judge"]
