"""KITTI scans, poses, and folders of scans as pairs: both scans of a pair end up in one frame."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from novelty import InputError
from novelty.cli import main
from novelty.io import Poses, read_entries, read_pairs, read_scan, read_sequence
from tests.helpers import room

NUM_SCANS = 4


def write_bin(path, points, columns=4):
    rows = np.zeros((len(points), columns), np.float32)
    rows[:, :3] = points
    path.parent.mkdir(parents=True, exist_ok=True)
    rows.tofile(path)
    return path


def motions(count=NUM_SCANS):
    """Poses (P, 4, 4) of a sensor that drives on and turns."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    for k in range(count):
        poses[k, :3, :3] = Rotation.from_euler("zyx", [0.3 * k, 0.05 * k, 0.02]).as_matrix()
        poses[k, :3, 3] = [2.0 * k, -k, 0.1 * k]
    return poses


def kitti_lines(poses):
    return "".join(" ".join(f"{value:.9e}" for value in pose[:3].ravel()) + "\n" for pose in poses)


def tum_lines(poses, times):
    rows = ["# timestamp tx ty tz qx qy qz qw"]
    for time, pose in zip(times, poses, strict=True):
        quaternion = 3.0 * Rotation.from_matrix(pose[:3, :3]).as_quat()  # of any length
        rows.append(f"{time:.6f} " + " ".join(map(repr, map(float, [*pose[:3, 3], *quaternion]))))
    return "\n".join(rows) + "\n"


def as_seen(world, pose):
    """Points of the world in the sensor's frame."""
    return (world - pose[:3, 3]) @ pose[:3, :3]


@pytest.fixture
def world(rng):
    return rng.uniform(-20, 20, (50, 3))


@pytest.fixture
def sequence(tmp_path, world):
    """KITTI's layout: sequences/00/velodyne/000000.bin ... and poses.txt beside velodyne."""
    folder = tmp_path / "sequences" / "00"
    for number, pose in enumerate(motions()):
        write_bin(folder / "velodyne" / f"{number:06d}.bin", as_seen(world, pose))
    (folder / "poses.txt").write_text(kitti_lines(motions()))
    return folder


# --- .bin


def test_a_bin_file_holds_float32_rows_seen_from_zero(tmp_path):
    points = np.array([[1.5, 2, -3], [np.nan, 0, 0], [80, -7, 1]])
    scan = read_scan(write_bin(tmp_path / "a.bin", points))
    np.testing.assert_array_equal(scan.points, points)
    np.testing.assert_array_equal(scan.origin, [0, 0, 0])
    np.testing.assert_array_equal(read_scan(write_bin(tmp_path / "a.pcd.bin", points, 5)).points, points)


def test_a_bin_file_of_something_else_is_refused(tmp_path):
    (tmp_path / "short.bin").write_bytes(b"1234567890")
    with pytest.raises(InputError, match="16 bytes each; found 10 bytes"):
        read_scan(tmp_path / "short.bin")
    np.full(8, 1e200).tofile(tmp_path / "doubles.bin")
    with pytest.raises(InputError, match="expected float32 coordinates in metres; point 0"):
        read_scan(tmp_path / "doubles.bin")


# --- poses


@pytest.mark.parametrize("form", ["kitti", "tum"])
def test_poses_bring_the_scans_of_a_sequence_into_one_frame(sequence, world, form):
    if form == "tum":
        (sequence / "poses.txt").write_text(tum_lines(motions(), 0.1 * np.arange(NUM_SCANS)))
    entries = read_sequence(sequence)
    assert [entry.name for entry in entries] == ["000000-000001", "000001-000002", "000002-000003"]
    for number, entry in enumerate(entries):
        pair = entry.load()
        np.testing.assert_allclose(pair.reference.points, world, atol=2e-5)
        np.testing.assert_allclose(pair.current.points, world, atol=2e-5)
        np.testing.assert_allclose(pair.reference.origin, motions()[number, :3, 3], atol=1e-8)
        np.testing.assert_allclose(pair.current.origin, motions()[number + 1, :3, 3], atol=1e-8)


def test_poses_of_the_camera_are_moved_to_the_scanner(sequence, world):
    scanner_in_camera = np.array([[0, -1, 0, 0.1], [0, 0, -1, -0.2], [1, 0, 0, 0.3], [0, 0, 0, 1]], float)
    of_camera = scanner_in_camera @ motions() @ np.linalg.inv(scanner_in_camera)
    (sequence / "poses.txt").write_text(kitti_lines(of_camera))
    row = " ".join(map(str, scanner_in_camera[:3].ravel()))
    (sequence / "calib.txt").write_text(f"P0: {row}\nTr: {row}\n")
    for entry in read_sequence(sequence):
        np.testing.assert_allclose(entry.load().current.points, world, atol=2e-5)


def test_a_step_pairs_scans_further_apart(sequence):
    assert [entry.name for entry in read_sequence(sequence, step=2)] == ["000000-000002", "000001-000003"]
    for step in (0, NUM_SCANS):
        with pytest.raises(InputError, match="expected a step from 1 to 3"):
            read_sequence(sequence, step=step)


def test_the_folder_of_the_scans_itself_and_the_poses_of_the_benchmark_are_found(sequence):
    whole = read_sequence(sequence)
    assert [entry.reference for entry in read_sequence(sequence / "velodyne")] == [
        entry.reference for entry in whole
    ]
    apart = sequence.parent.parent / "poses" / "00.txt"
    apart.parent.mkdir()
    (sequence / "poses.txt").rename(apart)
    assert {entry.poses.resolve() for entry in read_sequence(sequence)} == {apart.resolve()}
    assert {entry.poses.resolve() for entry in read_sequence(sequence / "velodyne")} == {apart.resolve()}


def test_a_folder_takes_the_place_of_a_manifest(sequence):
    assert read_entries(sequence) == list(read_sequence(sequence))
    assert read_pairs(sequence) == read_sequence(sequence)


def test_a_manifest_may_name_the_poses(sequence, world):
    manifest = sequence / "pairs.csv"
    manifest.write_text(
        "name,reference,current,poses\nfar,velodyne/000000.bin,velodyne/000003.bin,poses.txt\n"
    )
    (entry,) = read_pairs(manifest)
    np.testing.assert_allclose(entry.load().current.points, world, atol=2e-5)
    assert entry.files()[-1] == sequence / "poses.txt"
    manifest.write_text(
        "name,reference,current,poses\nfar,velodyne/000000.bin,velodyne/000003.bin,pose.txt\n"
    )
    with pytest.raises(InputError, match=r"line 2: the poses 'pose\.txt' are not a file"):
        read_pairs(manifest)


def test_of_a_part_of_a_sequence_the_name_tells_the_pose(sequence, world):
    (sequence / "velodyne" / "000001.bin").unlink()
    np.testing.assert_allclose(
        read_scan(sequence / "velodyne" / "000003.bin", poses=sequence / "poses.txt").points, world, atol=2e-5
    )
    write_bin(sequence / "velodyne" / "000009.bin", world)
    write_bin(sequence / "velodyne" / "000010.bin", world)
    with pytest.raises(InputError, match=r"has no pose for it.*found 5 and 4.*from 0 to 3"):
        read_scan(sequence / "velodyne" / "000009.bin", poses=sequence / "poses.txt")


@pytest.mark.parametrize("names", [("{:.6f}", 1.0), ("{:.0f}", 1e9)])
def test_of_a_trajectory_the_time_in_the_name_tells_the_pose(tmp_path, world, names):
    pattern, factor = names
    times = 1_700_000_000 + 0.1 * np.arange(NUM_SCANS)
    (tmp_path / "trajectory.tum").write_text(tum_lines(motions(), times))
    poses = Poses.read(tmp_path / "trajectory.tum")
    for number in (3, 1):  # only some of the scans are there
        time = (times[number] + 0.02) * factor
        file = write_bin(tmp_path / (pattern.format(time) + ".bin"), as_seen(world, motions()[number]))
        np.testing.assert_allclose(read_scan(file, poses=poses).points, world, atol=2e-5)
    late = write_bin(tmp_path / (pattern.format((times[-1] + 1) * factor) + ".bin"), world)
    with pytest.raises(InputError, match="has no pose for it"):
        read_scan(late, poses=poses)


def test_numbers_without_zeros_are_in_the_order_of_counting(tmp_path, world):
    for number, pose in enumerate(motions(11)):
        write_bin(tmp_path / f"scan{number + 1}.bin", as_seen(world, pose))  # counted from 1
    (tmp_path / "poses.txt").write_text(kitti_lines(motions(11)))
    entries = read_sequence(tmp_path)
    assert [entry.current.stem for entry in entries][-3:] == ["scan9", "scan10", "scan11"]
    np.testing.assert_allclose(entries[-1].load().current.points, world, atol=2e-5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n", "expected 12 numbers per line .* or 8 .*; found 3"),
        ("1 0 0 0 0 1 0 0 0 0 2 0\n", "pose 0, counted from 0, is not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "pose 0, counted from 0, is not a rotation"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 0\n", "pose 1, counted from 0, is not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 1\n1 0 zero\n", "line 2: expected numbers, found 'zero'"),
    ],
)
def test_damaged_poses_are_refused(tmp_path, text, message):
    (tmp_path / "poses.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        Poses.read(tmp_path / "poses.txt")
    with pytest.raises(InputError, match="no such file of poses"):
        Poses.read(tmp_path / "nowhere.txt")


def test_a_damaged_calibration_is_refused(sequence):
    (sequence / "calib.txt").write_text("P0: 1 2 3\n")
    with pytest.raises(InputError, match="expected a line 'Tr:' of 12 numbers"):
        read_sequence(sequence)


def test_a_folder_without_scans_or_poses_is_refused(tmp_path, sequence):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="expected scans whose names end in a number"):
        read_sequence(tmp_path / "empty")
    (sequence / "poses.txt").unlink()
    with pytest.raises(InputError, match=r"expected the poses of the scans in poses\.txt"):
        read_sequence(sequence)
    write_bin(sequence / "rear" / "000000.bin", np.zeros((1, 3)))
    with pytest.raises(InputError, match=r"found 1 like .*rear.*4 like .*velodyne.*Name the folder"):
        read_sequence(sequence)


def test_the_command_brings_scans_together_by_their_poses(tmp_path, capsys):
    for number, pose in enumerate(motions(2)):
        write_bin(tmp_path / f"{number:06d}.bin", as_seen(room(3000), pose))
    (tmp_path / "poses.txt").write_text(kitti_lines(motions(2)))
    scans = [str(tmp_path / f"{number:06d}.bin") for number in range(2)]
    with pytest.raises(SystemExit) as stop:
        main(["detect", *scans, "--poses", str(tmp_path / "poses.txt")])
    assert stop.value.code == 0
    assert "No change found" in capsys.readouterr().out
