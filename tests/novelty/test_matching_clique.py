"""The maximum clique: against networkx on random and correspondence-like graphs, ties, budget."""

import numpy as np
import pytest

from novelty.matching import CliqueStatus, maximum_clique
from tests.reference import clique as reference


def random_graph(seed: int, num_vertices: int, density: float) -> np.ndarray:
    upper = np.triu(np.random.default_rng(seed).uniform(size=(num_vertices, num_vertices)) < density, 1)
    return upper | upper.T


def correspondence_like(seed: int, K_a: int, K_b: int, density: float, num_true: int) -> np.ndarray:
    """All K_a K_b pairs as vertices, joined one-to-one by chance, with a planted matching of `num_true`."""
    first, second = np.divmod(np.arange(K_a * K_b), K_b)
    adjacency = random_graph(seed, K_a * K_b, density)
    planted = np.flatnonzero((first == second) & (first < num_true))
    adjacency[np.ix_(planted, planted)] = True
    return adjacency & (first[:, None] != first) & (second[:, None] != second)


def assert_heaviest(adjacency: np.ndarray, weights: np.ndarray, **options) -> tuple[int, ...]:
    found = maximum_clique(adjacency, weights, **options)
    assert found.status == CliqueStatus.MAXIMUM
    chosen = list(found.vertices)
    assert chosen == sorted(set(chosen))
    assert (adjacency[np.ix_(chosen, chosen)] | np.eye(len(chosen), dtype=bool)).all()
    total = sum(round(weights[v] * reference.WEIGHT_UNITS) for v in chosen)
    best = reference.maximum_clique(adjacency, weights)[1]
    assert abs(total - best) <= len(chosen)  # the rounding of either
    return found.vertices


@pytest.mark.parametrize("num_vertices", [1, 2, 5, 17, 40])
@pytest.mark.parametrize("density", [0.0, 0.2, 0.5, 0.8, 1.0])
def test_random_graphs_agree_with_networkx(num_vertices: int, density: float):
    for seed in range(8):
        adjacency = random_graph(seed, num_vertices, density)
        generator = np.random.default_rng(seed)
        assert_heaviest(adjacency, np.ones(num_vertices))
        assert_heaviest(adjacency, 1 - generator.uniform(size=num_vertices) / 400)
        assert_heaviest(adjacency, generator.uniform(0.01, 1, size=num_vertices))


@pytest.mark.parametrize(
    ("K_a", "K_b", "density", "num_true"),
    [(20, 20, 0.05, 14), (20, 23, 0.1, 12), (23, 20, 0.15, 3), (20, 20, 0.2, 10)],
)
def test_correspondence_like_graphs_agree_with_networkx(K_a: int, K_b: int, density: float, num_true: int):
    adjacency = correspondence_like(K_a, K_a, K_b, density, num_true)
    weights = 1 - np.random.default_rng(1).uniform(size=len(adjacency)) / 400
    found = assert_heaviest(adjacency, weights)
    assert len(found) >= num_true


def test_more_vertices_beat_any_weight_and_weight_breaks_ties():
    # A triangle of light vertices, an edge of heavy ones, and a second, heavier triangle.
    adjacency = np.zeros((8, 8), dtype=bool)
    for clique in ([0, 1, 2], [3, 4], [5, 6, 7]):
        adjacency[np.ix_(clique, clique)] = True
    np.fill_diagonal(adjacency, False)
    weights = np.array([0.9, 0.9, 0.9, 1.0, 1.0, 0.91, 0.9, 0.9])
    assert maximum_clique(adjacency, weights).vertices == (5, 6, 7)
    assert maximum_clique(adjacency, weights[::-1].copy()).vertices == (0, 1, 2)


def test_an_empty_graph_has_an_empty_clique():
    found = maximum_clique(np.zeros((0, 0), dtype=bool), np.zeros(0))
    assert found.vertices == ()
    assert found.status == CliqueStatus.MAXIMUM


def test_a_spent_budget_returns_a_clique_and_says_that_it_is_not_proven():
    adjacency = random_graph(3, 120, 0.9)
    found = maximum_clique(adjacency, np.ones(120), node_budget=50)
    chosen = list(found.vertices)
    assert found.status == CliqueStatus.NOT_PROVEN_MAXIMAL
    assert found.num_searched <= 51
    assert len(chosen) > 10
    assert (adjacency[np.ix_(chosen, chosen)] | np.eye(len(chosen), dtype=bool)).all()
    assert "budget" in found.status.advice


def test_the_same_graph_gives_the_same_clique():
    adjacency = random_graph(4, 60, 0.7)
    first, second = (maximum_clique(adjacency, np.ones(60)) for _ in range(2))
    assert first == second
