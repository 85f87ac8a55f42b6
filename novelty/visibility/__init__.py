"""What the other scan could see."""

from novelty.visibility.rays import Rays, Sight
from novelty.visibility.verdict import Visibility, judge

__all__ = ["Rays", "Sight", "Visibility", "judge"]
