"""Optimal transport: against POT, linear programming and definitions; certificates; degenerate mixtures."""

import numpy as np
import ot
import pytest
import torch
from scipy.optimize import linprog

from gmmtorch.transport import TransportStatus, emd, unbalanced_emd

SHAPES = [(1, 1), (1, 5), (4, 1), (3, 3), (8, 5), (16, 20)]


def random_problem(
    seed: int, num_pairs: int, K_a: int, K_b: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = np.random.default_rng(seed)
    points_a, points_b = (generator.uniform(0, 5, size=(num_pairs, k, 3)) for k in (K_a, K_b))
    cost = np.linalg.norm(points_a[:, :, None] - points_b[:, None], axis=-1)
    a, b = (generator.dirichlet(np.ones(k), size=num_pairs) for k in (K_a, K_b))
    return torch.from_numpy(a), torch.from_numpy(b), torch.from_numpy(cost)


def linear_program(sources: np.ndarray, sinks: np.ndarray, cost: np.ndarray) -> float:
    """Least cost of carrying `sources` to `sinks`, equal in total."""
    m, n = cost.shape
    rows = np.kron(np.eye(m), np.ones((1, n)))
    columns = np.kron(np.ones((1, m)), np.eye(n))
    # One of the m + n equations follows from the others.
    constraints, totals = np.vstack([rows, columns])[:-1], np.concatenate([sources, sinks])[:-1]
    return linprog(cost.ravel(), A_eq=constraints, b_eq=totals, method="highs").fun


def unbalanced_program(a: np.ndarray, b: np.ndarray, cost: np.ndarray, tau: float) -> float:
    """Least cost, from the definition with inequalities: what is not carried costs tau at either end."""
    m, n = cost.shape
    rows = np.kron(np.eye(m), np.ones((1, n)))
    columns = np.kron(np.ones((1, m)), np.eye(n))
    saved = linprog(
        (cost - 2 * tau).ravel(), A_ub=np.vstack([rows, columns]), b_ub=np.concatenate([a, b])
    ).fun
    return saved + tau * (a.sum() + b.sum())


@pytest.mark.parametrize(("K_a", "K_b"), SHAPES)
def test_emd_equals_pot_and_the_linear_program(K_a: int, K_b: int):
    a, b, cost = random_problem(1, 6, K_a, K_b)
    found = emd(a, b, cost)
    for p in range(6):
        x, y, c = a[p].numpy(), b[p].numpy(), cost[p].numpy()
        assert found.distance[p].item() == pytest.approx(ot.emd2(x, y / y.sum() * x.sum(), c), rel=1e-12)
        assert found.distance[p].item() == pytest.approx(linear_program(x, y, c), rel=1e-9)
    assert (found.status == TransportStatus.OPTIMAL).all()


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_plan_and_potentials_certify_the_distance(unit: float):
    a, b, cost = random_problem(2, 8, 9, 7)
    cost = cost * unit
    found = emd(a, b, cost)
    torch.testing.assert_close(found.plan.sum(dim=2), a)
    torch.testing.assert_close(found.plan.sum(dim=1), b)
    assert (found.plan >= 0).all()
    torch.testing.assert_close((found.plan * cost).sum(dim=(1, 2)), found.distance)
    slack = cost - found.potentials_a[:, :, None] - found.potentials_b[:, None, :]
    assert slack.min() >= -1e-15 * cost.max()
    assert (found.gap.abs() <= 1e-13 * cost.max()).all()


def test_padding_in_any_place_changes_nothing():
    a, b, cost = random_problem(3, 4, 6, 5)
    expected = emd(a, b, cost)
    rows, columns = torch.tensor([0, 2, 3, 5, 6, 8]), torch.tensor([1, 2, 4, 5, 6])
    padded_a, padded_b = torch.zeros(4, 9, dtype=torch.float64), torch.zeros(4, 7, dtype=torch.float64)
    padded_cost = torch.full((4, 9, 7), torch.nan, dtype=torch.float64)
    padded_a[:, rows], padded_b[:, columns] = a, b
    padded_cost[:, rows[:, None], columns] = cost
    found = emd(padded_a, padded_b, padded_cost)
    torch.testing.assert_close(found.distance, expected.distance, rtol=1e-14, atol=0)
    torch.testing.assert_close(found.plan[:, rows[:, None], columns], expected.plan, rtol=0, atol=1e-15)
    assert found.plan.sum() == pytest.approx(4)
    assert (found.potentials_a[:, [1, 4, 7]] == 0).all()


def test_weights_are_normalised_and_identical_mixtures_are_at_distance_zero():
    a, _, _ = random_problem(4, 3, 10, 10)
    points = torch.from_numpy(np.random.default_rng(4).normal(size=(3, 10, 3)))
    cost = torch.cdist(points, points, compute_mode="donot_use_mm_for_euclid_dist")
    found = emd(a, 7.0 * a, cost)
    assert found.distance.abs().max() < 1e-15
    assert (found.plan.diagonal(dim1=1, dim2=2) - a).abs().max() < 1e-15


def test_a_bad_pair_is_reported_in_its_place():
    a, b, cost = random_problem(5, 5, 4, 4)
    expected = emd(a, b, cost).distance
    a[1] = 0.0
    b[2, 0] = -0.1
    cost[3, 1, 1] = torch.nan
    found = emd(a, b, cost)
    S = TransportStatus
    assert found.status.tolist() == [S.OPTIMAL, S.NO_MASS, S.INVALID, S.INVALID, S.OPTIMAL]
    assert found.distance[1:4].isnan().all()
    torch.testing.assert_close(found.distance[[0, 4]], expected[[0, 4]])
    assert "not positive definite" in S(found.status[3].item()).advice


def test_shapes_that_do_not_fit_are_refused():
    a, b, cost = random_problem(6, 2, 3, 4)
    with pytest.raises(ValueError, match=r"\(B, K_a, K_b\)"):
        emd(b, a, cost)
    with pytest.raises(ValueError, match=r"\(B, K_a, K_b\)"):
        unbalanced_emd(a[0], b[0], cost[0], 1.0)


@pytest.mark.parametrize(("K_a", "K_b"), SHAPES)
@pytest.mark.parametrize("tau", [0.1, 0.7, 3.0])
def test_unbalanced_emd_equals_its_definition_as_a_linear_program(K_a: int, K_b: int, tau: float):
    a, b, cost = random_problem(7, 4, K_a, K_b)
    a, b = 1000 * a, 1400 * b
    found = unbalanced_emd(a, b, cost, tau)
    for p in range(4):
        expected = unbalanced_program(a[p].numpy(), b[p].numpy(), cost[p].numpy(), tau)
        assert found.total_cost[p].item() == pytest.approx(expected, rel=1e-9)
    torch.testing.assert_close(found.plan.sum(dim=2) + found.unmatched_a, a)
    torch.testing.assert_close(found.plan.sum(dim=1) + found.unmatched_b, b)
    assert (found.plan * (cost > 2 * tau)).sum() < 1e-10  # flows are exact up to rounding
    unmatched = found.unmatched_a.sum(dim=1) + found.unmatched_b.sum(dim=1)
    torch.testing.assert_close((found.plan * cost).sum(dim=(1, 2)) + tau * unmatched, found.total_cost)
    assert (found.gap.abs() <= 1e-12 * found.total_cost).all()


def test_unbalanced_emd_leaves_out_what_was_added_and_removed():
    places = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [9, 0, 0]], [[0, 0, 0], [1, 0, 0], [-9, 0, 0]]])
    a, b = torch.tensor([[100.0, 50.0, 500.0]]), torch.tensor([[100.0, 50.0, 20.0]])
    found = unbalanced_emd(a, b, torch.cdist(places[:1], places[1:]), tau=0.5)
    torch.testing.assert_close(found.unmatched_a, torch.tensor([[0, 0, 500.0]], dtype=torch.float64))
    torch.testing.assert_close(found.unmatched_b, torch.tensor([[0, 0, 20.0]], dtype=torch.float64))


def test_unbalanced_emd_takes_one_tau_per_pair_and_an_empty_side():
    a, b, cost = random_problem(8, 3, 5, 6)
    taus = torch.tensor([0.2, 0.5, 1.0])
    together = unbalanced_emd(a, b, cost, taus)
    for p in range(3):
        alone = unbalanced_emd(a[p : p + 1], b[p : p + 1], cost[p : p + 1], taus[p].item())
        torch.testing.assert_close(together.unmatched_a[p : p + 1], alone.unmatched_a, rtol=0, atol=1e-9)
    nothing = unbalanced_emd(torch.zeros_like(a), b, cost, 0.5)
    torch.testing.assert_close(nothing.unmatched_b, b)
    torch.testing.assert_close(nothing.total_cost, 0.5 * b.sum(dim=1))
    with pytest.raises(ValueError, match="tau"):
        unbalanced_emd(a, b, cost, 0.0)
