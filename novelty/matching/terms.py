"""The two readings of eq. 12: what its relative differences are differences of.

    w = sqrt(|d_Theta^2 - d_Gamma^2|)    squared, as printed
    w = sqrt(|d_Theta - d_Gamma|)        plain, the same without the squares

At the printed U_R = 1 the plain reading asks for |d_Theta - d_Gamma| <= 1, with the root or without it.
"""

from typing import Literal

from torch import Tensor

ArcTerms = Literal["squared", "plain"]
"""Whether the distances under the root of eq. 12 are squared."""


def arc_terms(distances: Tensor, terms: ArcTerms) -> Tensor:
    """What eq. 12 subtracts under its root, of distances of any shape; may be `distances` itself."""
    return distances.square() if terms == "squared" else distances
