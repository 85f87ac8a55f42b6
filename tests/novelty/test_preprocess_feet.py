"""What stands on the ground is told from it by the ground of the other scan."""

import numpy as np
import pytest

from novelty.preprocess import Preprocess, prepare_pairs
from novelty.preprocess.feet import feet_of
from novelty.preprocess.ground import Plane
from novelty.scan import Scan, ScanPair

UP = np.array([0.0, 0.0, 1.0])
GROUND = Plane(UP, 0.0, 0.04)
FLOOR = 8000


def _floor(rng, noise=0.004):
    return rng.uniform([0, 0, 0], [4, 3, 0], (FLOOR, 3)) + rng.normal(scale=noise, size=(FLOOR, 1)) * UP


def _box(rng, at=(1.5, 1.5)):
    """The front of a box of 15 cm."""
    return rng.uniform([*at, 0], [at[0] + 0.15, at[1], 0.15], (80, 3))


def _room(rng, *things):
    wall = rng.uniform([0, 3, 0], [4, 3, 2.5], (4000, 3))
    return np.concatenate([_floor(rng), wall, *things])


def test_a_box_that_appears_keeps_its_foot_and_the_floor_goes(rng):
    before, after = _room(rng), _room(rng, _box(rng))
    kept = {}
    for feet in (True, False):
        pairs = prepare_pairs([ScanPair(Scan(before), Scan(after))], Preprocess(feet=feet))
        kept[feet] = np.isin(np.arange(len(after)), pairs.current.kept[0])
        assert np.isin(np.arange(FLOOR), pairs.reference.kept[0]).mean() < 0.01
        assert kept[feet][:FLOOR].mean() < 0.01
    stands = np.flatnonzero(after[:, 2] > 0.02)
    stands = stands[stands >= FLOOR + 4000]
    assert kept[True][stands].all()
    assert kept[False][stands].mean() < 0.9


@pytest.mark.parametrize("noise", [0.0, 0.004])
@pytest.mark.parametrize("shift", [(0, 0, 0), (5e5, 4e6, 100)])
def test_two_scans_of_one_place_show_no_feet(rng, noise, shift):
    one, other = (np.concatenate([_floor(rng, noise), _box(rng)]) + shift for _ in range(2))
    ground = Plane(UP, float(shift[2]), 0.04)
    assert not feet_of(one, ground, one, ground).any()
    assert feet_of(one, ground, other, ground).sum() <= 2


def test_a_wrong_pose_moves_no_feet(rng):
    before, after = _floor(rng), np.concatenate([_floor(rng), _box(rng)])
    angle = np.radians(2)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    moved = before @ turn.T + [0.05, 0.05, 0.1]
    tilted = Plane(turn @ UP, float(turn @ UP @ [0.05, 0.05, 0.1]), 0.04)
    expected = feet_of(after, GROUND, before, GROUND)
    assert expected[FLOOR:].sum() > 8
    assert np.mean(feet_of(after, GROUND, moved, tilted)[FLOOR:] == expected[FLOOR:]) > 0.97


def test_a_lone_point_is_chance(rng):
    after = np.concatenate([_floor(rng), [[2.0, 1.0, 0.03]]])
    assert not feet_of(after, GROUND, _floor(rng), GROUND)[-1]


@pytest.mark.parametrize("count", [0, 1, 19])
def test_a_ground_of_a_few_points_tells_nothing(rng, count):
    after = np.concatenate([_floor(rng), _box(rng), [[3.0, 1.0, 0.03]]])
    assert not feet_of(after, GROUND, _floor(rng)[:count], GROUND).any()
    assert not feet_of(after[-1:], GROUND, after, GROUND).any()
    assert not feet_of(after[:0], GROUND, after, GROUND).any()
