"""Registration: right within millimetres, deaf to changes, tiny where nothing is to do, honest where it cannot."""

import numpy as np
import pytest
import torch

from gmmtorch import PointClouds
from novelty.preprocess import Preprocess, prepare_pairs
from novelty.preprocess.prepared import PreparedPairs, PreparedScans
from novelty.preprocess.simplify import Scale, simplify
from novelty.registration import Registration, Registrations, RegistrationStatus, register
from novelty.registration.motion import Motions, cross_matrices, rotations_of
from novelty.scan import ScanPair
from novelty.simulation.pairs import simulate_pair
from novelty.simulation.poses import random_motion, rotation, transform

NOISE = 0.008
METHODS = ("mixture", "gicp")


def sheet(rng: np.random.Generator, corner, first, second, density: float = 150.0) -> np.ndarray:
    """Points on a parallelogram, with noise across and along it."""
    corner, first, second = (np.asarray(value, dtype=float) for value in (corner, first, second))
    count = int(density * np.linalg.norm(np.cross(first, second)))
    places = corner + rng.random((count, 1)) * first + rng.random((count, 1)) * second
    return places + NOISE * rng.standard_normal((count, 3))


def box(rng: np.random.Generator, low, size) -> np.ndarray:
    """Points on the sides and the top of a box."""
    (x, y, z), (dx, dy, dz) = low, size
    return np.concatenate(
        [
            sheet(rng, (x, y, z), (dx, 0, 0), (0, 0, dz)),
            sheet(rng, (x, y + dy, z), (dx, 0, 0), (0, 0, dz)),
            sheet(rng, (x, y, z), (0, dy, 0), (0, 0, dz)),
            sheet(rng, (x + dx, y, z), (0, dy, 0), (0, 0, dz)),
            sheet(rng, (x, y, z + dz), (dx, 0, 0), (0, dy, 0)),
        ]
    )


def room(rng: np.random.Generator, changed: bool) -> np.ndarray:
    """Four walls, ceiling and a table; a cupboard 0.3 m away from where it was, and a new box, where `changed`."""
    shell = [
        sheet(rng, (0, 0, 0), (5, 0, 0), (0, 0, 2.6)),
        sheet(rng, (0, 4, 0), (5, 0, 0), (0, 0, 2.6)),
        sheet(rng, (0, 0, 0), (0, 4, 0), (0, 0, 2.6)),
        sheet(rng, (5, 0, 0), (0, 4, 0), (0, 0, 2.6)),
        sheet(rng, (0, 0, 2.6), (5, 0, 0), (0, 4, 0)),
        sheet(rng, (2, 1.5, 0.75), (1.4, 0, 0), (0, 0.8, 0)),
    ]
    things = [box(rng, (0.4 + 0.3 * changed, 0.5, 0), (0.5, 1.2, 1.9))]
    if changed:
        things.append(box(rng, (3.5, 2.6, 0), (0.7, 0.6, 0.6)))
    return np.concatenate(shell + things)


def scans(clouds: list[np.ndarray], spreads: bool = True) -> PreparedScans:
    """Prepared scans of clouds from which nothing was taken out."""
    points = PointClouds.from_list(clouds)
    simplified = simplify(points, Scale())
    nan = torch.full((len(clouds),), torch.nan, dtype=torch.float64)
    return PreparedScans(
        cells=simplified.cells if spreads else points,
        points=points,
        cell_of_point=simplified.cell_of_point if spreads else torch.arange(len(points.points)),
        kept=tuple(np.arange(len(cloud)) for cloud in clouds),
        num_given=tuple(len(cloud) for cloud in clouds),
        origins=(None,) * len(clouds),
        returns=tuple(clouds),
        dropped=({},) * len(clouds),
        spacing=nan,
        cell_size=nan,
        notes=((),) * len(clouds),
    )


def pairs(references: list[np.ndarray], currents: list[np.ndarray], spreads: bool = True) -> PreparedPairs:
    return PreparedPairs(reference=scans(references, spreads), current=scans(currents, spreads))


def error_about(centre: np.ndarray, shift: float, degrees: float, seed: int = 0) -> np.ndarray:
    motion = random_motion(shift, degrees, np.random.default_rng(seed))
    motion[:3, 3] += centre - motion[:3, :3] @ centre
    return motion


def left(found: Registrations, index: int, error: np.ndarray, centre: np.ndarray) -> tuple[float, float]:
    """What is left of the pose error: m at `centre`, and degrees."""
    motion = found.transforms[index].numpy() @ error
    skew = motion[:3, :3] - motion[:3, :3].T
    turn = np.degrees(np.linalg.norm(skew[[2, 0, 1], [1, 2, 0]]) / 2)
    return float(np.linalg.norm(transform(motion, centre) - centre)), float(turn)


CENTRE = np.array([2.5, 2.0, 1.3])
REFERENCE = room(np.random.default_rng(1), changed=False)
CURRENT = room(np.random.default_rng(2), changed=True)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("shift", "degrees"), [(0.02, 0.5), (0.05, 1.0), (0.1, 2.0)])
def test_a_pose_error_is_taken_out_although_things_have_changed(method, shift, degrees):
    error = error_about(CENTRE, shift, degrees)
    found = register(pairs([REFERENCE], [transform(error, CURRENT)]), Registration(method=method))
    metres, turn = left(found, 0, error, CENTRE)
    assert found.status_of(0) is RegistrationStatus.OK
    assert metres < 0.003
    assert turn < 0.05
    assert found.residual[0] < 0.01
    assert 0.75 < found.overlap[0] < 0.99
    assert found.observable[0] == 6
    assert found.turn[0] == pytest.approx(degrees, abs=0.05)
    assert found.note(0) == ""


def test_a_good_pose_is_left_alone():
    found = register(pairs([REFERENCE], [CURRENT]), Registration(method="mixture"))
    assert found.shift[0] < 0.002
    assert found.turn[0] < 0.05
    assert found.residual[0] < 0.01


def test_none_moves_nothing_and_measures_the_misalignment():
    batch = pairs(
        [REFERENCE] * 3, [transform(error_about(CENTRE, s, 0.0), CURRENT) for s in (0.0, 0.02, 0.06)]
    )
    found = register(batch, Registration(method="none"))
    assert torch.equal(found.transforms, torch.eye(4, dtype=torch.float64).expand(3, 4, 4))
    assert found.residual[0] < 0.01
    # A shift shows across the surfaces that face it: a third of its square on average.
    assert found.residual[0] < found.residual[1] < 0.02
    assert 0.02 < found.residual[2] < 0.06
    assert {found.status_of(p) for p in range(3)} == {RegistrationStatus.NOT_ASKED}


def test_a_pair_is_registered_alike_alone_and_in_company():
    errors = [error_about(CENTRE, 0.05, 1.0, seed) for seed in (1, 2)]
    currents = [transform(error, CURRENT) for error in errors]
    together = register(pairs([REFERENCE, REFERENCE[::2]], currents), Registration())
    alone = register(pairs([REFERENCE[::2]], currents[1:]), Registration())
    torch.testing.assert_close(together.transforms[1:], alone.transforms, rtol=0, atol=1e-9)
    torch.testing.assert_close(together.residual[1:], alone.residual, rtol=0, atol=1e-9)


def test_far_from_the_origin_the_answer_is_the_same():
    far = np.array([5e5, -4e5, 300.0])
    error = error_about(CENTRE, 0.05, 1.0)
    moved = transform(error, CURRENT)
    near = register(pairs([REFERENCE], [moved]), Registration())
    there = register(pairs([REFERENCE + far], [moved + far]), Registration())
    places = transform(there.transforms[0].numpy(), moved + far) - far
    np.testing.assert_allclose(places, transform(near.transforms[0].numpy(), moved), atol=1e-4)
    assert there.shift[0] == pytest.approx(float(near.shift[0]), abs=1e-4)


def test_points_without_spreads_are_registered_too():
    error = error_about(CENTRE, 0.05, 1.0)
    batch = pairs([REFERENCE], [transform(error, CURRENT)], spreads=False)
    assert left(register(batch, Registration()), 0, error, CENTRE)[0] < 0.003


def test_a_corridor_is_not_moved_along_its_axis():
    def corridor(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        return np.concatenate(
            [
                sheet(rng, (0, 0, 0), (20, 0, 0), (0, 0, 2.5)),
                sheet(rng, (0, 2, 0), (20, 0, 0), (0, 0, 2.5)),
                sheet(rng, (0, 0, 2.5), (20, 0, 0), (0, 2, 0)),
            ]
        )

    error = np.eye(4)
    error[:3, 3] = 0.05, 0.04, -0.03
    found = register(pairs([corridor(1)], [transform(error, corridor(2))]), Registration())
    assert found.status_of(0) is RegistrationStatus.UNOBSERVABLE
    assert found.observable[0] == 5
    assert "5 of 6" in found.note(0)
    np.testing.assert_allclose(found.transforms[0, :3, 3], [0.0, -0.04, 0.03], atol=0.004)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("moved", [0.4, 0.8])
def test_things_that_moved_along_a_corridor_do_not_take_it_with_them(moved, method):
    """They alone face its axis, and where they stand now they have no counterpart."""

    def corridor(seed: int, first: float) -> np.ndarray:
        rng = np.random.default_rng(seed)
        walls = [sheet(rng, (0, y, 0), (20, 0, 0), (0, 0, 2.4)) for y in (0, 1.8)]
        floors = [sheet(rng, (0, 0, z), (20, 0, 0), (0, 1.8, 0)) for z in (0, 2.4)]
        return np.concatenate(
            [*walls, *floors, *(box(rng, (first + 8 * i, 0, 0), (0.25, 0.25, 0.8)) for i in range(2))]
        )

    batch = pairs([corridor(1, 1)], [corridor(2, 1 + moved) + np.array([0, 0.05, 0])])
    found = register(batch, Registration(method=method))
    assert found.observable[0] == 5
    np.testing.assert_allclose(found.transforms[0, :3, 3], [0.0, -0.05, 0.0], atol=0.003)


def test_a_turn_about_the_axis_of_a_long_corridor_is_fixed_by_its_walls():
    rng = np.random.default_rng(5)
    walls = [sheet(rng, (-30, y, -1.2), (60, 0, 0), (0, 0, 2.4), 60) for y in (-0.9, 0.9)]
    floors = [sheet(rng, (-30, -0.9, z), (60, 0, 0), (0, 1.8, 0), 60) for z in (-1.2, 1.2)]
    cloud = np.concatenate(walls + floors)
    roll = np.eye(4)
    roll[:3, :3] = rotation([1.0, 0.0, 0.0], 2.0)
    found = register(pairs([cloud[::2]], [transform(roll, cloud[1::2])]), Registration())
    assert found.observable[0] == 5
    assert found.turn[0] == pytest.approx(2.0, abs=0.1)


def test_a_fit_that_is_another_place_is_no_refinement():
    """From inside a cabinet a corridor looks like any box: it fits best after a quarter turn, 4 m away."""
    stands = ((1.46, 0.1, 1.0), (2.6356, 1.0327, 1.0))
    scans = simulate_pair("corridor", 2, (), noise=0.01, origins=stands, density=0.25).scans
    settings = Preprocess(outliers="statistical")
    batch = prepare_pairs([ScanPair(scans.reference, scans.current)], settings, "m")
    found = register(batch, Registration())
    assert found.status_of(0).kept_given_pose
    assert found.status_of(0) is not RegistrationStatus.NO_BETTER
    assert torch.equal(found.transforms[0], torch.eye(4).double())


def test_a_plane_is_moved_across_only():
    flat = [sheet(np.random.default_rng(seed), (0, 0, 0), (6, 0, 0), (0, 5, 0)) for seed in (1, 2)]
    error = np.eye(4)
    error[:3, :3] = rotation((1, 0, 0), 0.5)
    error[:3, 3] = 0.05, 0.05, 0.05
    found = register(pairs(flat[:1], [transform(error, flat[1])]), Registration())
    assert found.status_of(0) is RegistrationStatus.UNOBSERVABLE
    assert found.observable[0] == 3
    moved = transform(found.transforms[0].numpy() @ error, flat[1])
    assert np.abs(moved[:, 2]).mean() < 2 * NOISE
    assert np.abs(moved[:, 0] - flat[1][:, 0] - 0.05).max() < 0.005


def test_two_different_places_keep_the_given_pose_and_say_so():
    elsewhere = room(np.random.default_rng(3), changed=False) + np.array([30.0, 0.0, 0.0])
    found = register(pairs([REFERENCE], [elsewhere]), Registration())
    assert found.status_of(0).kept_given_pose
    assert torch.equal(found.transforms[0], torch.eye(4, dtype=torch.float64))
    assert "given pose was kept" in found.note(0)


def test_scans_without_cells_keep_their_place_and_say_so():
    error = error_about(CENTRE, 0.05, 1.0)
    empty, few = np.zeros((0, 3)), CURRENT[:40]
    moved = transform(error, CURRENT)
    batch = pairs([empty, REFERENCE, REFERENCE, REFERENCE], [moved, empty, few, moved])
    for method in ("none", *METHODS):
        found = register(batch, Registration(method=method))
        assert torch.isfinite(found.transforms).all()
        if method != "none":
            assert [found.status_of(p).name for p in range(4)] == ["TOO_FEW_CELLS"] * 3 + ["OK"]
            assert left(found, 3, error, CENTRE)[0] < 0.003


@pytest.mark.data
def test_a_fixed_camera_is_left_alone(data_dir):
    from novelty.io.manifest import read_pairs
    from novelty.preprocess import Preprocess, prepare

    for entry in read_pairs(data_dir / "mosd" / "pairs-tune.csv"):
        pair = entry.load()
        prepared = prepare([pair.reference, pair.current], Preprocess())
        found = register(PreparedPairs(prepared.select([0]), prepared.select([1])), Registration())
        assert found.shift[0] < 0.002
        assert found.turn[0] < 0.05


def test_rotations_are_the_exponentials_of_their_vectors_and_do_not_depend_on_the_batch():
    lengths = torch.logspace(-9, 0.4, 40, dtype=torch.float64)[:, None]
    vectors = lengths * torch.randn(40, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    together = rotations_of(vectors)
    torch.testing.assert_close(together, torch.linalg.matrix_exp(cross_matrices(vectors)), rtol=0, atol=1e-14)
    for n in range(40):
        assert torch.equal(rotations_of(vectors[n : n + 1])[0], together[n])
    assert torch.equal(rotations_of(torch.zeros(1, 3).double())[0], torch.eye(3).double())


def test_steps_lead_to_the_motion_that_they_were_read_off():
    steps = torch.tensor(
        [[0.3, -1.2, 2.0, 1.0, 2.0, -3.0], [0.0] * 6, [1e-9, 0.0, 0.0, 0.0, 0.0, 0.0]]
    ).double()
    motions = Motions.identity(3).then(steps)
    torch.testing.assert_close(motions.steps(), steps, rtol=1e-12, atol=1e-15)
    half_turn = Motions(
        torch.diag(torch.tensor([1.0, -1.0, -1.0])).double()[None], torch.zeros(1, 3).double()
    )
    assert half_turn.angles().tolist() == [180.0]
