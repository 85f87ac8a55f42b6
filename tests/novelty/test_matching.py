"""Structural matching: graphs against the equations written out, and what is left unmatched."""

import numpy as np
import pytest
import torch

from gmmtorch.distances import combined_distance
from novelty.errors import ConfigError
from novelty.matching import (
    ArcTerms,
    CliqueStatus,
    Components,
    build_correspondence_graphs,
    match_structure,
    merge_cut_components,
)
from tests.reference import clique as reference


def random_scene(seed: int, K: int, num_new: int) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Means and covariances of two mixtures of one room; the first `num_new` of the first are elsewhere."""
    generator = np.random.default_rng(seed)
    means = generator.uniform(0, 4, size=(K, 3))
    rotations = np.linalg.qr(generator.normal(size=(K, 3, 3)))[0]
    covariances = rotations * 10 ** generator.uniform(-2, 0, size=(K, 1, 3)) @ rotations.transpose(0, 2, 1)
    moved = means + generator.normal(scale=0.02, size=means.shape)
    moved[:num_new] = generator.uniform(8, 12, size=(num_new, 3))
    return (moved, covariances * generator.uniform(0.99, 1.01, size=(K, 1, 1))), (means, covariances)


def components(sides: list[tuple[np.ndarray, ...]], K: int) -> Components:
    """Mixtures padded to K components."""
    P = len(sides)
    weights, means = torch.zeros(P, K, dtype=torch.float64), torch.zeros(P, K, 3, dtype=torch.float64)
    covariances = torch.eye(3, dtype=torch.float64).repeat(P, K, 1, 1)
    for p, (mean, covariance) in enumerate(sides):
        size = len(mean)
        weights[p, :size] = 1 / max(size, 1)
        means[p, :size], covariances[p, :size] = torch.from_numpy(mean), torch.from_numpy(covariance)
    return Components(weights, means, covariances)


@pytest.mark.parametrize(("terms", "power"), [("squared", 2), ("plain", 1)])
@pytest.mark.parametrize(
    ("node_threshold", "arc_threshold", "length_scale"), [(3.5, 1.0, 1.0), (2.0, 2.5, 0.5), (6.0, 1.5, 3.0)]
)
def test_graphs_hold_the_nodes_and_arcs_of_the_equations(
    node_threshold: float, arc_threshold: float, length_scale: float, terms: ArcTerms, power: int
):
    scenes = [random_scene(seed, K, K // 4) for seed, K in enumerate([1, 3, 5, 6])]
    a, b = components([x for x, _ in scenes], 6), components([y for _, y in scenes], 8)
    graphs = build_correspondence_graphs(
        a,
        b,
        node_threshold=node_threshold,
        arc_threshold=arc_threshold,
        length_scale=length_scale,
        terms=terms,
    )
    for p, (first, second) in enumerate(scenes):
        V = int(graphs.num_nodes[p])
        found = list(zip(graphs.nodes_a[p, :V].tolist(), graphs.nodes_b[p, :V].tolist(), strict=True))
        nodes, arcs = reference.correspondence_graph(
            first, second, node_threshold, arc_threshold, length_scale, power
        )
        assert found == nodes
        assert (graphs.nodes_a[p, V:] == -1).all()
        assert (graphs.nodes_b[p, V:] == -1).all()
        assert not graphs.adjacency[p, V:].any()
        assert not graphs.adjacency[p, :, V:].any()
        joined = {frozenset([found[x], found[y]]) for x, y in graphs.adjacency[p].nonzero().tolist()}
        assert joined == arcs
        assert torch.equal(graphs.adjacency[p], graphs.adjacency[p].T)
        expected = [graphs.table[p, i, j].item() for i, j in nodes]
        assert graphs.distances[p, :V].tolist() == expected
        assert graphs.distances[p, V:].isinf().all()


def two_components(apart: float, shapes_apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Two round components whose means are `apart` and whose covariances have this distance (eq. 10)."""
    means = np.array([[0.0, 0.0, 0.0], [apart, 0.0, 0.0]])
    # All three generalized eigenvalues of exp(t) I and I are exp(t), so that d_Sigma = sqrt(3) t.
    return means, np.stack([np.eye(3), np.exp(shapes_apart / 3**0.5) * np.eye(3)])


@pytest.mark.parametrize(
    ("terms", "apart", "shapes_apart", "by_hand"),
    [
        ("squared", (5.0, 5.2), (1.0, 1.0), (27.04 - 25.0) ** 0.5),
        ("plain", (5.0, 5.2), (1.0, 1.0), 0.2**0.5),
        ("squared", (5.0, 5.0), (8.0, 8.1), (65.61 - 64.0) ** 0.5),
        ("plain", (5.0, 5.0), (8.0, 8.1), 0.1**0.5),
    ],
)
def test_both_readings_of_equation_12_by_hand(
    terms: ArcTerms, apart: tuple[float, float], shapes_apart: tuple[float, float], by_hand: float
):
    a, b = (
        components([two_components(d, s)], 2)
        for d, s in zip(reversed(apart), reversed(shapes_apart), strict=True)
    )
    for arc_threshold, joined in ((by_hand - 1e-6, False), (by_hand + 1e-6, True)):
        graphs = build_correspondence_graphs(a, b, arc_threshold=arc_threshold, terms=terms)
        nodes = list(zip(graphs.nodes_a[0].tolist(), graphs.nodes_b[0].tolist(), strict=True))
        (first, second) = nodes.index((0, 0)), nodes.index((1, 1))
        assert graphs.adjacency[0, first, second].item() is joined


def test_a_batch_larger_than_one_chunk_equals_its_members():
    scenes = [random_scene(seed, 16, 3) for seed in range(9)]
    a, b = components([x for x, _ in scenes], 16), components([y for _, y in scenes], 16)
    together = build_correspondence_graphs(a, b, node_threshold=50.0, arc_threshold=2.0)
    assert (together.num_nodes == 256).all()
    for p in range(9):
        alone = build_correspondence_graphs(
            components([scenes[p][0]], 16),
            components([scenes[p][1]], 16),
            node_threshold=50.0,
            arc_threshold=2.0,
        )
        assert torch.equal(alone.adjacency[0], together.adjacency[p])


def test_every_old_component_is_matched_and_every_new_one_is_left():
    num_new = [0, 1, 4, 2]
    scenes = [random_scene(10 + seed, 12, new) for seed, new in enumerate(num_new)]
    a, b = components([x for x, _ in scenes], 14), components([y for _, y in scenes], 13)
    matches = match_structure(build_correspondence_graphs(a, b))
    for p, new in enumerate(num_new):
        assert matches.partners_a[p].tolist() == [-1] * new + list(range(new, 12)) + [-1, -1]
        assert matches.partners_b[p].tolist() == [-1] * new + list(range(new, 12)) + [-1]
        assert matches.num_matches[p] == 12 - new
    assert (matches.status == CliqueStatus.MAXIMUM).all()


def test_the_clique_is_the_one_networkx_finds():
    scenes = [random_scene(20 + seed, 10, 3) for seed in range(4)]
    a, b = components([x for x, _ in scenes], 10), components([y for _, y in scenes], 10)
    graphs = build_correspondence_graphs(a, b, node_threshold=6.0, arc_threshold=2.5)
    matches = match_structure(graphs)
    for p in range(4):
        V = int(graphs.num_nodes[p])
        distances = graphs.distances[p, :V].numpy()
        adjacency = graphs.adjacency[p, :V, :V].numpy()
        expected, _ = reference.maximum_clique(adjacency, 1 - distances / (6.0 * 10**2))
        assert matches.num_matches[p] == len(expected)
        matched = (matches.partners_a[p] >= 0).nonzero().ravel()
        total = graphs.table[p, matched, matches.partners_a[p, matched]].sum()
        assert total.item() == pytest.approx(distances[expected].sum(), abs=1e-7)


def test_mixtures_that_share_nothing_have_no_match():
    first, second = random_scene(30, 5, 5)
    matches = match_structure(build_correspondence_graphs(components([first], 5), components([second], 5)))
    assert (matches.partners_a == -1).all()
    assert (matches.partners_b == -1).all()
    assert matches.num_matches.tolist() == [0]
    assert matches.status.tolist() == [CliqueStatus.MAXIMUM]


def test_thresholds_must_be_positive_numbers():
    side = components([random_scene(31, 2, 0)[0]], 2)
    for name in ("node_threshold", "arc_threshold"):
        for value in (0.0, -1.0, float("inf"), float("nan")):
            with pytest.raises(ConfigError, match=name):
                build_correspondence_graphs(side, side, **{name: value})


def metres(a: Components, b: Components) -> torch.Tensor:
    return combined_distance(a.means, a.covariances, b.means, b.covariances)


def cut(mean, covariance, axis: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Means (2, 3) and covariances (2, 3, 3) of the halves of a Gaussian, left and right of its mean."""
    deviation = np.sqrt(covariance[axis, axis])
    offset = np.eye(3)[axis] * deviation * np.sqrt(2 / np.pi)
    half = covariance - np.outer(offset, offset)
    return np.stack([mean - offset, mean + offset]), np.stack([half, half])


def test_halves_are_joined_where_the_other_mixture_has_the_whole_and_a_new_thing_is_not():
    wall, floor = np.diag([1.0, 0.01, 0.5]), np.diag([2.0, 1.0, 0.01])
    whole = (np.array([[0.0, 3.0, 1.0], [0.0, 0.0, 0.0]]), np.stack([wall, floor]))
    means, covariances = cut(whole[0][0], wall)
    box_mean, box = np.array([[0.3, 2.7, 0.3]]), np.diag([0.02, 0.02, 0.03])[None]
    pieces = (
        np.concatenate([whole[0][1:], means[:1], box_mean, means[1:]]),
        np.concatenate([whole[1][1:], covariances[:1], box, covariances[1:]]),
    )
    a, b = components([pieces, whole], 4), components([whole, whole], 3)
    merged = merge_cut_components(a, b, metres)
    assert merged.groups[0].tolist() == [0, 1, 2, 1]  # floor, half, box, half
    assert merged.groups[1].tolist() == [0, 1, 2, 3]  # nothing was cut
    np.testing.assert_allclose(merged.components.means[0, 1], whole[0][0], atol=1e-12)
    np.testing.assert_allclose(merged.components.covariances[0, 1], wall, atol=1e-12)
    assert merged.components.weights[0].tolist() == [0.25, 0.5, 0.25, 0.0]
    assert merged.spread(torch.tensor([[5, 6, 7, 8]] * 2))[0].tolist() == [5, 6, 7, 6]
    alone = merge_cut_components(components([pieces], 4), components([whole], 3), metres)
    assert alone.groups.tolist() == merged.groups[:1].tolist()


def test_quarters_are_joined_in_several_rounds_and_nothing_without_another_side():
    wall = np.diag([4.0, 0.01, 0.5])
    means, covariances = cut(np.zeros(3), wall)
    quarters = [cut(mean, covariance) for mean, covariance in zip(means, covariances, strict=True)]
    pieces = (np.concatenate([m for m, _ in quarters]), np.concatenate([c for _, c in quarters]))
    merged = merge_cut_components(
        components([pieces], 4), components([(np.zeros((1, 3)), wall[None])], 1), metres
    )
    assert merged.groups.tolist() == [[0, 0, 0, 0]]
    nothing = (np.empty((0, 3)), np.empty((0, 3, 3)))
    assert merge_cut_components(
        components([pieces], 4), components([nothing], 2), metres
    ).groups.tolist() == [[0, 1, 2, 3]]
