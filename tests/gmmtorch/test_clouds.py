"""The packed batch of clouds."""

import numpy as np
import pytest
import torch

from gmmtorch import ArgumentError, PointClouds, ShapeError
from tests.helpers import room


def test_packing_keeps_order_and_sizes():
    first, second = room(5), torch.as_tensor(room(3, 1), dtype=torch.float32)
    clouds = PointClouds.from_list(
        [first, np.zeros((0, 3)), second], [np.ones(5), np.ones(0), [1.0, 0.0, 2.0]]
    )
    assert (clouds.batch_size, clouds.dim, clouds.sizes) == (3, 3, (5, 0, 3))
    assert clouds.offsets == (0, 5, 5, 8)
    assert clouds.points.dtype == torch.float64
    assert clouds.cloud_index.tolist() == [0] * 5 + [2] * 3
    assert clouds.total_weights.tolist() == [5.0, 0.0, 3.0]
    assert torch.equal(clouds.split(clouds.points)[2], second.double())


def test_packing_copies():
    points = room(4)
    clouds = PointClouds.from_list([points])
    points[:] = 0
    assert clouds.points.abs().sum() > 0


def test_selecting():
    clouds = PointClouds.from_list([room(4), room(2, 1)], spreads=[np.zeros((4, 3, 3)), np.ones((2, 3, 3))])
    picked = clouds.select([1, 0, 1])
    assert picked.sizes == (2, 4, 2)
    assert torch.equal(picked[2].points, clouds[1].points)
    assert torch.equal(clouds[-1].spreads, torch.ones(2, 3, 3, dtype=torch.float64))
    with pytest.raises(IndexError):
        clouds[2]
    with pytest.raises(ArgumentError):
        clouds.select([])


def test_precision_is_a_property_of_the_batch():
    clouds = PointClouds.from_list([room(4)], dtype=torch.float32)
    assert clouds.dtype == torch.float32
    assert clouds.points.dtype == torch.float64
    assert clouds.to(dtype=torch.float64).dtype == torch.float64
    with pytest.raises(ArgumentError, match="float16"):
        clouds.to(dtype=torch.float16)


@pytest.mark.parametrize(
    ("points", "kwargs", "error", "message"),
    [
        ([], {}, ShapeError, "empty list"),
        ([np.zeros(3)], {}, ShapeError, "cloud 0"),
        ([np.zeros((2, 3)), np.zeros((2, 2))], {}, ShapeError, "cloud 1 has 2"),
        ([np.zeros((2, 3))], {"weights": [np.ones(3)]}, ShapeError, "weights"),
        ([np.zeros((2, 3))], {"weights": [np.ones(2), np.ones(2)]}, ShapeError, "expected 1 arrays"),
        ([np.zeros((2, 3))], {"weights": [-np.ones(2)]}, ArgumentError, ">= 0"),
        ([np.zeros((2, 3))], {"spreads": [np.zeros((2, 3))]}, ShapeError, "spreads"),
        ([np.zeros((2, 3))], {"dtype": torch.int64}, ArgumentError, "dtype"),
        ([np.zeros((2, 3), dtype=complex)], {}, ArgumentError, "complex"),
    ],
)
def test_bad_input_is_named(points, kwargs, error, message):
    with pytest.raises(error, match=message):
        PointClouds.from_list(points, **kwargs)
