"""What a result says of itself."""

from dataclasses import replace

import numpy as np

from novelty.result import PointState
from tests.novelty.report_case import make_pair, make_result


def test_a_result_is_printed_in_one_line_of_counts():
    result = make_result(make_pair(num_points=2000))
    states = result.removed.point_states.copy()
    states[:5], states[5:7] = PointState.OCCLUDED, PointState.UNOBSERVED
    result = replace(result, removed=replace(result.removed, point_states=states))
    assert repr(result) == (
        "NoveltyResult(name='room', changed=True, p_value=1e-09, status='ok', "
        "added=Change(points=2200, novel=200, occluded=0, unobserved=0, components=9, objects=1), "
        "removed=Change(points=2200, novel=200, occluded=5, unobserved=2, components=9, objects=1))"
    )


def test_records_are_printed_in_one_line():
    change = make_result(make_pair(num_points=2000)).added
    component = replace(change.components[8], mean=np.array([1.23456, 2, 3]))
    thing = replace(change.objects[0], centroid=np.zeros(3), extent=np.array([2.5, 1, 0.5]), motion=np.eye(4))
    assert repr(component) == "ComponentRecord(index=8, novel=True, num_points=200, mean=(1.235, 2.0, 3.0))"
    assert repr(thing) == (
        "ObjectRecord(index=0, kind='added', num_points=200, centroid=(0.0, 0.0, 0.0), extent=(2.5, 1.0, 0.5))"
    )


def test_points_are_counted_by_state():
    change = make_result(make_pair(num_points=2000)).added
    assert change.count(PointState.NOT_EXAMINED) == 7
    assert change.num_examined == 2193
    assert change.count(PointState.NOVEL) == change.point_labels.sum()
