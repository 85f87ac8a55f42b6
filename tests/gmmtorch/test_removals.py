"""Greedy removals: the same answer as the plain loop over POT, with fewer problems solved."""

import numpy as np
import pytest
import torch

from gmmtorch.removals import Removals, greedy_removals
from gmmtorch.transport import TransportStatus, emd
from tests.reference import transport as reference


def changed_rooms(
    seed: int, num_pairs: int, K: int, num_new: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of mixtures that share most components, noisily; the first `num_new` of a lie elsewhere."""
    generator = np.random.default_rng(seed)
    means_b = generator.uniform(0, 6, size=(num_pairs, K, 3))
    means_a = means_b + generator.normal(scale=0.1, size=means_b.shape)
    means_a[:, :num_new] = generator.uniform(0, 6, size=(num_pairs, num_new, 3))
    a = generator.dirichlet(3 * np.ones(K), size=num_pairs)
    b = a * generator.uniform(0.9, 1.1, size=a.shape)
    b[:, :num_new] *= 0.3
    return a, b, np.linalg.norm(means_a[:, :, None] - means_b[:, None], axis=-1)


def remove(a: np.ndarray, b: np.ndarray, cost: np.ndarray, **options) -> Removals:
    return greedy_removals(*(torch.from_numpy(x) for x in (a, b, cost)), **options)


def assert_same_course(found: Removals, a: np.ndarray, b: np.ndarray, cost: np.ndarray, **options) -> None:
    for p in range(len(a)):
        order, distances = reference.greedy_removals(a[p], b[p], cost[p], **options)
        length = len(order)
        assert found.order[p, 1 : length + 1].tolist() == order
        assert (found.order[p, length + 1 :] == -1).all()
        np.testing.assert_allclose(found.distances[p, : length + 1], distances, rtol=1e-10, atol=1e-12)
        left = a[p].sum() - a[p][order[:-1]].sum()
        share = 1 - a[p][order[-1]] / left if order and options.get("until") == "work" else 1
        put_back = length > 0 and distances[-1] * share > distances[-2] + 1e-9 * cost[p].max()
        assert found.removed[p].nonzero().ravel().tolist() == sorted(order[:-1] if put_back else order)
        assert found.num_removed[p] == length - put_back


@pytest.mark.parametrize("options", [{}, {"renormalise": False}, {"until": "work"}])
@pytest.mark.parametrize(("K", "num_new"), [(1, 0), (2, 1), (3, 1), (6, 3), (16, 3), (16, 16)])
def test_the_answer_is_that_of_the_plain_loop(K: int, num_new: int, options: dict):
    problem = changed_rooms(K + num_new, 12, K, num_new)
    assert_same_course(remove(*problem, **options), *problem, **options)


@pytest.mark.parametrize("renormalise", [True, False])
def test_ties_are_broken_as_in_the_plain_loop(renormalise: bool):
    generator = np.random.default_rng(1)
    means = generator.integers(0, 3, size=(2, 20, 9, 3)).astype(float)  # on a grid: most distances coincide
    cost = np.linalg.norm(means[0][:, :, None] - means[1][:, None], axis=-1)
    uniform = np.full((20, 9), 1 / 9)
    found = remove(uniform, uniform, cost, renormalise=renormalise)
    assert_same_course(found, uniform, uniform, cost, renormalise=renormalise)


def test_fewer_than_a_quarter_of_the_problems_are_solved():
    K = 16
    found = remove(*changed_rooms(2, 40, K, 3))
    rounds = (found.order >= 0).sum(dim=1)
    plain = 1 + rounds * K - rounds * (rounds - 1) // 2
    assert 4 * found.num_solves.sum() < plain.sum()


def test_an_added_component_is_removed_and_the_raising_removal_is_put_back():
    places = torch.tensor([[[0.0, 0, 0], [2, 0, 0], [0, 3, 0], [9, 9, 0]]], dtype=torch.float64)
    a = torch.tensor([[0.2, 0.2, 0.2, 0.4]], dtype=torch.float64)
    b = torch.tensor([[1.0, 1.0, 1.0, 0.0]], dtype=torch.float64)
    found = greedy_removals(a, b, torch.cdist(places, places))
    assert found.removed.tolist() == [[False, False, False, True]]
    assert found.order[0, 1] == 3
    assert found.order[0, 2] >= 0
    assert found.distances[0, 1] == pytest.approx(0, abs=1e-12)
    assert found.distances[0, 2] > 0.1


def test_what_was_added_hides_what_is_gone_from_the_distance_and_not_from_the_work():
    cost = 0.6 * (1 - np.eye(6))[None]
    cost[0, 4:] = cost[0, :, 4:] = 0.9  # the last two are far from everything
    cost[0, 4, 5] = 0.8  # and, if anything, nearer to each other
    added = np.array([[0.2, 0.2, 0.2, 0.1, 0.3, 0.0]])
    gone = np.array([[0.23, 0.23, 0.23, 0.115, 0.0, 0.195]])
    backward = gone, added, cost.transpose(0, 2, 1)
    assert not remove(*backward).removed.any()
    assert remove(*backward, until="work").removed[0].nonzero().ravel().tolist() == [5]
    for until in ("distance", "work"):
        assert remove(added, gone, cost, until=until).removed[0].nonzero().ravel().tolist() == [4]


@pytest.mark.parametrize("until", ["distance", "work"])
def test_identical_mixtures_lose_nothing(until: str):
    a, _, cost = changed_rooms(3, 5, 8, 0)
    symmetric = np.abs(cost - cost.transpose(0, 2, 1)) + 1 - np.eye(8)
    found = remove(a, a, symmetric, until=until)
    assert not found.removed.any()
    assert (found.distances[:, 0].abs() < 1e-15).all()


def test_padding_is_never_removed_and_changes_nothing():
    a, b, cost = changed_rooms(4, 6, 7, 2)
    expected = remove(a, b, cost)
    padded_cost = np.full((6, 9, 8), np.nan)
    padded_cost[:, 1:8, :7] = cost
    padded_a, padded_b = np.pad(a, ((0, 0), (1, 1))), np.pad(b, ((0, 0), (0, 1)))
    found = remove(padded_a, padded_b, padded_cost)
    assert torch.equal(found.removed[:, 1:8], expected.removed)
    assert not found.removed[:, [0, 8]].any()
    expected_order = torch.where(expected.order >= 0, expected.order + 1, -1)
    assert torch.equal(found.order[:, :7], expected_order)


def test_partial_distances_remove_all_but_one():
    found = remove(*changed_rooms(5, 10, 6, 1), renormalise=False)
    assert (found.num_removed == 5).all()


def test_the_full_order_goes_on_to_the_last_component_without_changing_the_answer():
    a, b, cost = changed_rooms(6, 10, 8, 2)
    short, full = remove(a, b, cost), remove(a, b, cost, full_order=True)
    assert torch.equal(short.removed, full.removed)
    assert torch.equal(short.num_removed, full.num_removed)
    listed = short.order >= 0
    assert torch.equal(short.order[listed], full.order[listed])
    assert full.order[:, 1:].sort(dim=1).values.diff(dim=1).min() > 0
    assert full.distances.isfinite().all()
    last = 28 - full.order[:, 1:].sum(dim=1)  # 0 + ... + 7 less those removed
    expected = [(b[p] / b[p].sum()) @ cost[p, i] for p, i in enumerate(last.tolist())]
    np.testing.assert_allclose(full.distances[:, -1], expected)


def test_the_first_distance_is_the_earth_movers_distance():
    a, b, cost = changed_rooms(7, 5, 9, 2)
    found = remove(a, b, cost)
    expected = emd(*(torch.from_numpy(x) for x in (a, b, cost)))
    torch.testing.assert_close(found.distances[:, 0], expected.distance)


def test_a_bad_pair_is_reported_in_its_place():
    a, b, cost = changed_rooms(8, 3, 5, 1)
    a[0], cost[1, 2, 2] = 0.0, np.nan
    found = remove(a, b, cost)
    assert found.status.tolist() == [
        TransportStatus.NO_MASS,
        TransportStatus.INVALID,
        TransportStatus.OPTIMAL,
    ]
    assert not found.removed[:2].any()
    assert found.distances[:2].isnan().all()
    assert found.distances[2, 0].isfinite()
