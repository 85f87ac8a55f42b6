import numpy as np
import pytest
import torch

from gmmtorch import PointClouds
from novelty.preprocess.simplify import Scale, simplify
from tests.reference.simplification import partition


def _room(rng, num_points):
    walls = rng.uniform(0, [4.0, 3.0, 2.5], (num_points, 3))
    walls[: num_points // 3, 2] = 0
    walls[num_points // 3 : 2 * num_points // 3, 0] = 0
    return walls + rng.normal(scale=0.01, size=walls.shape)


def _cases():
    rng = np.random.default_rng(7)
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 2, [0.0]), axis=-1).reshape(-1, 3) * [1, 1.3, 1]
    return {
        "room": _room(rng, 3000),
        "far away": _room(rng, 800) + np.array([5e5, 4.2e6, 100.0]),
        "isotropic": rng.normal(size=(500, 3)),
        "tiny": 1e-9 * rng.normal(size=(200, 3)),
        "coplanar": rng.normal(size=(400, 3)) * [1, 1, 0],
        "collinear": np.outer(rng.normal(size=300), [1.0, 2.0, -1.0]),
        "grid": grid,
        "duplicates": np.repeat(rng.normal(size=(40, 3)), 30, axis=0)[rng.permutation(1200)],
        "one place": np.full((100, 3), 0.1),
        "doubling gaps": np.outer(2.0 ** np.arange(60), [1.0, 0.5, 0.0]),
        "twenty": rng.normal(size=(20, 3)),
        "three": rng.normal(size=(3, 3)),
        "two": rng.normal(size=(2, 3)),
        "one": rng.normal(size=(1, 3)),
        "empty": np.zeros((0, 3)),
    }


CASES = _cases()
SCALES = [
    Scale("or", 20, 0.1),
    Scale("and", 20, 0.1),
    Scale("or", 1, 0.1),
    Scale("or", 7, 1 / 3),
    Scale("or", 50, 0.0),
]


def _members(simplified, cloud):
    """Local indices of the points of every cell of one cloud."""
    cells, owner = simplified.cells, simplified.cell_of_point
    return [torch.nonzero(owner == cell)[:, 0].numpy() for cell in range(*cells.offsets[cloud : cloud + 2])]


@pytest.mark.parametrize("scale", SCALES, ids=str)
@pytest.mark.parametrize("name", CASES)
def test_cells_are_those_of_the_recursive_partition(name, scale):
    points = CASES[name]
    simplified = simplify(PointClouds.from_list([points]), scale)
    expected = partition(points, scale.rule, scale.max_size, scale.max_surface_variation)
    found = _members(simplified, 0)
    assert [cell.tolist() for cell in found] == [cell.tolist() for cell in expected]


@pytest.mark.parametrize("name", CASES)
def test_cells_are_counts_means_and_covariances_of_their_points(name):
    points = CASES[name]
    simplified = simplify(PointClouds.from_list([points]), Scale())
    scale = np.ptp(points, axis=0).max() if len(points) else 1.0
    for cell, members in enumerate(_members(simplified, 0)):
        part = points[members] - points.mean(axis=0)
        assert simplified.cells.weights[cell] == len(members)
        np.testing.assert_allclose(
            simplified.cells.points[cell], points[members].mean(axis=0), atol=1e-9 * scale
        )
        expected = np.cov(part.T, bias=True) if len(part) > 1 else np.zeros((3, 3))
        np.testing.assert_allclose(simplified.cells.spreads[cell], expected, atol=1e-12 * scale**2, rtol=1e-9)


@pytest.mark.parametrize("scale", SCALES[:3], ids=str)
def test_a_batch_equals_its_members_alone_in_any_order(scale):
    names = sorted(CASES)
    together = simplify(PointClouds.from_list([CASES[name] for name in names]), scale)
    owners = torch.split(together.cell_of_point, [len(CASES[name]) for name in names])
    for cloud, name in enumerate(names):
        alone = simplify(PointClouds.from_list([CASES[name]]), scale)
        start, stop = together.cells.offsets[cloud : cloud + 2]
        for attribute in ("points", "weights", "spreads"):
            part = getattr(together.cells, attribute)[start:stop]
            np.testing.assert_array_equal(
                part, getattr(alone.cells, attribute), err_msg=f"{attribute} of {name!r}"
            )
        np.testing.assert_array_equal(owners[cloud] - start, alone.cell_of_point, err_msg=name)


def test_cells_are_ordered_by_their_smallest_point():
    points = CASES["room"][np.random.default_rng(3).permutation(3000)]
    owner = simplify(PointClouds.from_list([points]), Scale()).cell_of_point.numpy()
    _, first = np.unique(owner, return_index=True)
    assert (np.diff(first) > 0).all()


def test_or_bounds_both_size_and_surface_variation():
    cells = simplify(PointClouds.from_list([CASES["room"]]), Scale("or", 20, 0.1)).cells
    variances = torch.linalg.eigvalsh(cells.spreads)
    total = variances.sum(-1)
    assert cells.weights.max() <= 20
    assert (variances[:, 0] <= 0.1 * total + 1e-12).all()


def test_cells_use_fewer_of_the_points_where_the_surface_is_flat():
    rng = np.random.default_rng(0)
    flat, rough = rng.uniform(size=(2, 2000, 3))
    flat[:, 2] = rng.normal(scale=1e-3, size=2000)
    cells = simplify(PointClouds.from_list([flat, rough]), Scale()).cells
    assert cells.sizes[1] > 1.5 * cells.sizes[0]


def test_a_batch_of_nothing_has_no_cells():
    simplified = simplify(PointClouds.from_list([np.zeros((0, 3)), np.zeros((0, 3))]), Scale())
    assert simplified.cells.sizes == (0, 0)
    assert simplified.cell_of_point.shape == (0,)
