"""Where the components start."""

import numpy as np
import pytest
import torch

import gmmtorch
from gmmtorch import INITIALIZERS, PointClouds
from gmmtorch.hierarchy import merged_groups
from tests.helpers import blobs, hostile_clouds, room


def known_to(name, clouds):
    """Mixtures for the initialiser that needs some."""
    return gmmtorch.fit_mdl(clouds, 2).mixtures if name == "from_mixtures" else None


@pytest.mark.parametrize("name", sorted(INITIALIZERS))
@pytest.mark.parametrize("kind", sorted(hostile_clouds()))
def test_every_initializer_copes_with_hostile_clouds(name, kind):
    clouds = PointClouds.from_list([hostile_clouds()[kind], blobs(300)])
    fit = gmmtorch.fit_mdl(clouds, 4, initializer=name, initial=known_to(name, clouds))
    for tensor in (fit.mixtures.weights, fit.mixtures.means, fit.mixtures.covariances):
        assert torch.isfinite(tensor).all()


@pytest.mark.parametrize("name", sorted(INITIALIZERS))
def test_a_start_does_not_depend_on_the_company(name):
    clouds = [room(900, seed=1), blobs(400), room(1500, seed=2)]
    batch = PointClouds.from_list(clouds)
    known = known_to(name, batch)
    together = gmmtorch.fit_mdl(batch, 6, initializer=name, initial=known, seed=3)
    for b in range(len(clouds)):
        own = None if known is None else known[b]
        alone = gmmtorch.fit_mdl(batch[b], 6, initializer=name, initial=own, seed=3)
        means = together.mixtures[b].trim().means
        torch.testing.assert_close(alone.mixtures.trim().means, means, rtol=0, atol=1e-8)


def test_merged_finds_well_separated_blobs_without_em():
    rng = np.random.default_rng(5)
    centres = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]])
    points = np.concatenate([centre + 0.05 * rng.normal(size=(200, 3)) for centre in centres])
    groups = merged_groups(PointClouds.from_list([points]), [4])
    torch.testing.assert_close(groups.weights[0], torch.full((4,), 0.25, dtype=torch.float64))
    found = groups.means[0].numpy()
    distance = np.linalg.norm(found[:, None] - centres, axis=-1)
    assert sorted(distance.argmin(axis=1)) == [0, 1, 2, 3]
    assert distance.min(axis=1).max() < 0.02


def test_merged_keeps_the_moments_of_the_whole_cloud():
    points = room(2000)
    groups = merged_groups(PointClouds.from_list([points]), [7])
    weights, means, covariances = (value[0].numpy() for value in groups)
    np.testing.assert_allclose(weights @ means, points.mean(axis=0), atol=1e-10)
    apart = means - points.mean(axis=0)
    whole = np.einsum("k,kij->ij", weights, covariances + apart[:, :, None] * apart[:, None, :])
    np.testing.assert_allclose(whole, np.cov(points.T, bias=True) + 1e-8 * np.eye(3), atol=1e-10)


def test_merged_treats_a_cell_as_its_points():
    rng = np.random.default_rng(8)
    cells = [rng.normal(loc=10 * np.eye(3)[k % 3], scale=0.1, size=(50, 3)) for k in range(6)]
    means = np.stack([cell.mean(axis=0) for cell in cells])
    spreads = np.stack([np.cov(cell.T, bias=True) for cell in cells])
    of_cells = merged_groups(
        PointClouds.from_list([means], weights=[np.full(6, 50.0)], spreads=[spreads]), [3]
    )
    of_points = merged_groups(PointClouds.from_list([np.concatenate(cells)]), [3])
    order, other = of_cells.means[0].argmax(0), of_points.means[0].argmax(0)
    torch.testing.assert_close(of_cells.means[0][order], of_points.means[0][other], rtol=0, atol=1e-9)
    torch.testing.assert_close(
        of_cells.covariances[0][order], of_points.covariances[0][other], rtol=0, atol=1e-9
    )


def test_merged_groups_of_a_cloud_do_not_depend_on_the_orders_of_the_others():
    clouds = PointClouds.from_list([room(600, 1), room(400, 2), room(600, 1)])
    together = merged_groups(clouds, [4, 9, 2])
    for cloud, order in enumerate([4, 9, 2]):
        alone = merged_groups(clouds[cloud], [order])
        for mixed, own in zip(together, alone, strict=True):
            torch.testing.assert_close(mixed[cloud, :order], own[0], rtol=0, atol=0)
    assert (together.weights[0, 4:] == 0).all()


def test_from_mixtures_finds_what_a_known_mixture_does_not_explain():
    walls, box = room(3000), np.array([8.0, 0, 1]) + 0.2 * np.random.default_rng(0).normal(size=(300, 3))
    before = gmmtorch.fit_mdl(PointClouds.from_list([walls]), 8)
    changed = PointClouds.from_list([np.concatenate([walls, box])])
    room_left = int(before.mixtures.num_components[0]) + 2
    fit = gmmtorch.fit_mdl(changed, room_left, initial=before.mixtures)
    nearest = (fit.mixtures.means[0] - torch.tensor([8.0, 0, 1])).norm(dim=1).amin()
    assert float(nearest) < 0.1
    unchanged = gmmtorch.fit_mdl(PointClouds.from_list([walls]), room_left, initial=before.mixtures)
    assert float(unchanged.mdl[0]) <= float(before.mdl[0]) + 5.0


def test_from_mixtures_asks_for_what_it_needs():
    clouds = PointClouds.from_list([room(300)])
    with pytest.raises(gmmtorch.ArgumentError, match="pass `initial`"):
        gmmtorch.fit_mdl(clouds, 4, initializer="from_mixtures")
    with pytest.raises(gmmtorch.ArgumentError, match="raise max_components"):
        gmmtorch.fit_mdl(clouds, 1, initial=gmmtorch.fit_em(clouds, 3).mixtures)
