"""Algorithm 2 as it is printed: one transport problem for every remaining component in every round."""

import numpy as np
import ot

TIE = 1e-12  # of the largest cost; the smaller index goes first


def greedy_removals(
    a: np.ndarray,
    b: np.ndarray,
    cost: np.ndarray,
    *,
    tolerance: float = 1e-9,
    renormalise: bool = True,
    until: str = "distance",
) -> tuple[list[int], list[float]]:
    """Components removed one after the other until one raises the distance (or work), and the distances."""
    a, b = a / a.sum(), b / b.sum()
    scale = cost.max()
    remaining = [s for s in range(len(a)) if a[s] > 0]
    order: list[int] = []
    distances = [distance(a, b, cost, remaining, renormalise)]
    while len(remaining) > 1:
        found = {s: distance(a, b, cost, [i for i in remaining if i != s], renormalise) for s in remaining}
        least = min(found.values())
        chosen = min(s for s, value in found.items() if value <= least + TIE * scale)
        remaining.remove(chosen)
        order.append(chosen)
        distances.append(found[chosen])
        share = 1 - a[chosen] / (a[remaining].sum() + a[chosen]) if until == "work" else 1
        if distances[-1] * share > distances[-2] + tolerance * scale:
            break
    return order, distances


def distance(a: np.ndarray, b: np.ndarray, cost: np.ndarray, rows: list[int], renormalise: bool) -> float:
    """Distance of the mixture reduced to `rows`; partial: the rest of b stays unserved."""
    carried = a[rows].sum()
    rows_cost, masses = cost[rows], a[rows]
    if not renormalise:
        rows_cost = np.vstack([rows_cost, np.zeros_like(b)])
        masses = np.append(masses, max(1 - carried, 0.0))
    plan = ot.emd(masses / masses.sum(), b, rows_cost)
    return float((plan * rows_cost).sum() / (1 if renormalise else carried))
