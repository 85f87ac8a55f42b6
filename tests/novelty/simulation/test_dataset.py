"""Data sets on disk: the same bytes from the same seed, readable here and elsewhere, with everything that is known."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from novelty.cli import main
from novelty.io import load_pairs
from novelty.simulation import load_experiment
from novelty.simulation.dataset import write_dataset


@pytest.fixture(scope="module")
def mobile(tmp_path_factory):
    """One pair of the robot that drives, on disk and in memory."""
    folder = tmp_path_factory.mktemp("mobile")
    pairs = replace(load_experiment("mobile_platform"), repetitions=1).pairs()[1:2]
    (made,) = write_dataset(pairs, folder)
    return folder, made


def contents(folder):
    return {
        path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(tmp_path):
    experiment = replace(load_experiment("static_platform"), repetitions=1)
    for folder, seed in (("one", 100), ("same", 100), ("other", 101)):
        list(write_dataset(replace(experiment, seed=seed).pairs(), tmp_path / folder))
    one, same, other = (contents(tmp_path / name) for name in ("one", "same", "other"))
    assert one == same
    assert len(one) == 2 + 3 * 7
    for path, same_place in zip(sorted(one), sorted(other), strict=True):
        if path.name in {"reference.ply", "current.ply"}:
            assert one[path] != other[same_place]


def test_what_was_written_is_read_back(mobile):
    folder, made = mobile
    (pair,) = load_pairs(folder / "pairs.csv")
    for read, written in ((pair.reference, made.scans.reference), (pair.current, made.scans.current)):
        assert np.array_equal(read.points, written.points)
        assert np.array_equal(read.labels, written.labels)
        assert np.array_equal(read.origin, written.origin)
    assert pair.name == made.scans.name == "person-1000"


def test_the_origin_of_a_standing_sensor_is_in_the_manifest(tmp_path):
    pairs = replace(load_experiment("viewpoint"), cases=load_experiment("viewpoint").cases[5:6]).pairs()
    (made,) = write_dataset(pairs, tmp_path)
    (pair,) = load_pairs(tmp_path / "pairs.csv")
    assert np.array_equal(pair.current.origin, made.scans.current.origin)
    assert pair.current.origin.shape == (3,)
    assert next(csv.DictReader((tmp_path / "conditions.csv").open()))["viewpoint"] == "[0.8, 0.5, 0]"


def test_other_tools_read_the_points(mobile):
    import open3d as o3d

    folder, made = mobile
    cloud = o3d.t.io.read_point_cloud(str(folder / "person-1000" / "current.ply"))
    assert np.array_equal(cloud.point.positions.numpy(), made.scans.current.points)
    assert np.array_equal(cloud.point["label"].numpy().ravel(), made.current.labels)
    assert set(cloud.point) >= {"object", "state", "hidden", "sweep", "origin_x"}


def test_objects_have_one_number_in_both_scans(mobile):
    import open3d as o3d

    folder, made = mobile
    rows = list(csv.DictReader((folder / "person-1000" / "objects.csv").open()))
    assert [row["object"] for row in rows] == [str(place) for place in range(len(rows))]
    assert {row["name"] for row in rows if row["state"] == "added"} == {"person 1"}
    for role, truth in (("reference", made.reference), ("current", made.current)):
        cloud = o3d.t.io.read_point_cloud(str(folder / "person-1000" / f"{role}.ply"))
        numbers = cloud.point["object"].numpy().ravel()
        assert [rows[number]["name"] for number in numbers[::997]] == [
            truth.names[place] for place in truth.objects[::997]
        ]


def test_poses_are_those_of_the_sweeps(mobile):
    folder, made = mobile
    believed, true = (
        np.loadtxt(folder / "person-1000" / f"current_{kind}.txt").reshape(-1, 3, 4)
        for kind in ("poses", "true_poses")
    )
    measured = made.measurements[1]
    assert np.array_equal(believed, measured.believed[:, :3])
    assert np.array_equal(true, measured.poses[:, :3])
    assert np.array_equal(made.scans.current.origin, believed[measured.sweeps, :, 3])


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    return stop.value.code, *capsys.readouterr()


def test_the_command_writes_an_experiment(tmp_path, capsys):
    code, out, _ = run(capsys, "simulate", "ideal_corridor", "--count", "2", "--out", str(tmp_path))
    assert code == 0
    assert "2 pairs" in out
    pairs = list(load_pairs(tmp_path / "pairs.csv"))
    assert [pair.name for pair in pairs] == ["box-1000", "box-1001"]
    assert all((pair.current.labels == 1).any() and pair.current.origin is None for pair in pairs)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("statik",), "no experiment 'statik'"),
        (("box_size", "--scene", "room"), "says itself what its scene is"),
        (("--change", "fire"), "there is no 'fire'"),
        (("--sensor", "utm"), "there is no 'utm'"),
    ],
)
def test_what_cannot_be_simulated_is_refused(tmp_path, capsys, arguments, message):
    code, _, err = run(capsys, "simulate", *arguments, "--out", str(tmp_path / "none"))
    assert code == 2
    assert message in " ".join(err.split())
    assert not (tmp_path / "none").exists()
