import numpy as np
import pytest

from novelty import InputError, Scan


def test_a_scan_keeps_order_count_and_missing_returns():
    points = np.array([[1, 2, 3], [np.nan, np.nan, np.nan], [np.inf, 0, 0]])
    scan = Scan(points, origin=[0, 0, 1], labels=[0, 1, 255], name="hall")
    np.testing.assert_array_equal(scan.points, points)
    assert scan.num_points == 3
    assert scan.points.dtype == np.float64
    assert scan.labels.dtype == np.uint8


def test_a_scan_cannot_be_changed_and_does_not_share_memory():
    points = np.zeros((2, 3))
    scan = Scan(points, origin=np.zeros(3), labels=np.zeros(2, int))
    points[0] = 7
    assert scan.points[0, 0] == 0
    for array in (scan.points, scan.origin, scan.labels):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_a_moving_sensor_has_one_origin_per_point():
    assert Scan(np.zeros((4, 3)), origin=np.ones((4, 3))).origin.shape == (4, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": np.zeros((3, 2))}, r"scan 'hall': points must have shape \(N, 3\).*got \(3, 2\)"),
        ({"points": np.zeros(3)}, "points must have shape"),
        ({"points": [["a", "b", "c"]]}, "must be an array of numbers"),
        (
            {"points": np.zeros((5, 3)), "origin": np.zeros((4, 3))},
            r"\(5, 3\) for a moving sensor; got \(4, 3\)",
        ),
        ({"points": np.zeros((5, 3)), "labels": np.zeros(4)}, r"labels must have shape \(5,\)"),
        ({"points": np.zeros((2, 3)), "labels": [0, 3]}, "must be 0, 1, 2 or 255; found 0, 3"),
    ],
)
def test_what_is_not_a_scan_is_refused_by_name(arguments, message):
    with pytest.raises(InputError, match=message):
        Scan(**arguments, name="hall")
