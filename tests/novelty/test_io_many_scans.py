"""Files of several scans: E57 surveys and ROS bags, and the addresses that name one scan in them."""

import sys
from pathlib import Path

import numpy as np
import pytest

from novelty import InputError, MissingDependencyError
from novelty.io import read_pairs, read_scan
from novelty.io.address import ScanAddress

POINTS = np.array([[1.5, -2.25, 3], [0, 0, 0], [-7, 8.5, 9], [2, 2, 2]])
QUARTER_TURN = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # about z; w first, as pye57 has it


# --- addresses


@pytest.mark.parametrize(
    ("text", "file", "part"),
    [
        ("a/survey.e57", "a/survey.e57", ""),
        ("a/survey.e57#2", "a/survey.e57", "2"),
        ("drive.bag#/lidar/points:12", "drive.bag", "/lidar/points:12"),
        ("#odd", "#odd", ""),
    ],
)
def test_the_part_follows_the_first_mark(text, file, part):
    assert ScanAddress.parse(text) == ScanAddress(Path(file), part)


def test_a_file_whose_name_has_the_mark_is_a_file(tmp_path):
    (tmp_path / "a#1.xyz").write_text("1 2 3\n")
    assert read_scan(tmp_path / "a#1.xyz").num_points == 1


def test_a_part_of_a_file_with_one_scan_is_refused(tmp_path):
    (tmp_path / "a.xyz").write_text("1 2 3\n")
    with pytest.raises(InputError, match=r"a \.xyz file holds one scan; leave out '#1'"):
        read_scan(tmp_path / "a.xyz#1")


@pytest.mark.parametrize(
    ("name", "library"), [("a.e57", "pye57"), ("a.bag", "rosbags"), ("a.mcap", "rosbags")]
)
def test_a_missing_library_is_named_with_its_command(tmp_path, monkeypatch, name, library):
    for module in [library, *(name for name in sys.modules if name.startswith(f"{library}."))]:
        monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / name).write_bytes(b"something")
    with pytest.raises(MissingDependencyError, match=rf"{library}.*pip install 'novelty-gmm\[formats\]'"):
        read_scan(tmp_path / name)


# --- E57


def write_e57(path, *stations):
    """Each station: the columns of `write_scan_raw`, and its rotation and translation."""
    pye57 = pytest.importorskip("pye57")
    with pye57.E57(str(path), mode="w") as file:
        for columns, rotation, translation in stations:
            file.write_scan_raw(columns, rotation=np.asarray(rotation), translation=np.asarray(translation))
    return path


def cartesian(points, **more):
    return {f"cartesian{axis}": np.ascontiguousarray(points[:, k]) for k, axis in enumerate("XYZ")} | more


@pytest.fixture
def survey(tmp_path):
    return write_e57(
        tmp_path / "survey.e57",
        (cartesian(POINTS), [1, 0, 0, 0], [10.0, 0, 0]),
        (cartesian(POINTS[:2]), QUARTER_TURN, [0, 5.0, 1]),
    )


def test_one_station_of_an_e57_file_lies_where_its_pose_says(survey):
    scan = read_scan(f"{survey}#1")
    np.testing.assert_allclose(scan.points, [[2.25, 6.5, 4], [0, 5, 1]], atol=1e-12)
    np.testing.assert_allclose(scan.origin, [0, 5, 1])
    assert scan.name == f"{survey}#1"


def test_all_stations_of_an_e57_file_are_one_scan_with_an_origin_per_point(survey):
    scan = read_scan(survey)
    np.testing.assert_allclose(scan.points[:4], POINTS + np.array([10, 0, 0]))
    np.testing.assert_allclose(scan.points[4:], read_scan(f"{survey}#1").points)
    np.testing.assert_allclose(scan.origin, [[10, 0, 0]] * 4 + [[0, 5, 1]] * 2)


def test_invalid_points_of_an_e57_file_keep_their_place(tmp_path):
    invalid = np.array([0, 1, 0, 0], np.int8)
    columns = cartesian(POINTS, cartesianInvalidState=invalid, intensity=np.ones(4, np.float32))
    scan = read_scan(write_e57(tmp_path / "a.e57", (columns, [1, 0, 0, 0], [0, 0, 0.0])))
    assert np.isnan(scan.points[1]).all()
    np.testing.assert_allclose(scan.points[[0, 2, 3]], POINTS[[0, 2, 3]])


@pytest.mark.parametrize("part", ["2", "-1", "first"])
def test_a_station_that_is_not_there_is_refused(survey, part):
    with pytest.raises(InputError, match="expected the number of a scan after '#', from 0 to 1"):
        read_scan(f"{survey}#{part}")


def test_a_damaged_e57_file_is_refused(survey):
    survey.write_bytes(survey.read_bytes()[:300])
    with pytest.raises(InputError, match="pye57 cannot read the file"):
        read_scan(survey)


# --- ROS bags


def cloud_message(store, points, big=False, padding=0):
    """A PointCloud2 of two rows with x, y, z in float32 and a byte, `padding` bytes after each row."""
    order = ">" if big else "<"
    kind = np.dtype(
        [("x", f"{order}f4"), ("y", f"{order}f4"), ("z", f"{order}f4"), ("label", "u1"), ("_", "V3")]
    )
    rows = np.zeros(len(points), kind)
    for k, axis in enumerate("xyz"):
        rows[axis] = points[:, k]
    rows["label"] = [0, 1, 2, 255][: len(points)]
    width = len(points) // 2
    content = b"".join(rows[k * width : (k + 1) * width].tobytes() + b"\xff" * padding for k in range(2))
    types = store.types
    field = types["sensor_msgs/msg/PointField"]
    more = {"seq": 0} if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    return types["sensor_msgs/msg/PointCloud2"](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="lidar", **more),
        height=2,
        width=width,
        fields=[field(axis, 4 * k, 7, 1) for k, axis in enumerate("xyz")] + [field("label", 12, 2, 1)],
        is_bigendian=big,
        point_step=kind.itemsize,
        row_step=width * kind.itemsize + padding,
        data=np.frombuffer(content, np.uint8),
        is_dense=True,
    )


def write_bag(path, topics, storage="", **options):
    """A ROS 1 bag for `.bag`, otherwise a ROS 2 bag; `topics` maps names to lists of points."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    first = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    writer = Writer1(path) if first else Writer2(path, version=9, storage_plugin=StoragePlugin[storage])
    pack = store.serialize_ros1 if first else store.serialize_cdr
    kind = "sensor_msgs/msg/PointCloud2"
    with writer:
        for topic, clouds in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for number, points in enumerate(clouds):
                message = cloud_message(store, points, **options)
                writer.write(connection, 1_000_000_000 * (number + 1), pack(message, kind))
    return path


@pytest.mark.parametrize("options", [{}, {"big": True}, {"padding": 5}])
@pytest.mark.parametrize(("name", "storage"), [("a.bag", ""), ("a", "SQLITE3"), ("b", "MCAP")])
def test_the_only_cloud_of_a_bag_needs_no_part(tmp_path, name, storage, options):
    path = write_bag(tmp_path / name, {"/points": [POINTS]}, storage, **options)
    scan = read_scan(path)
    np.testing.assert_array_equal(scan.points, POINTS)
    np.testing.assert_array_equal(scan.labels, [0, 1, 2, 255])
    assert scan.origin is None
    for file in [*path.glob("*.mcap"), *path.glob("*.db3")]:
        np.testing.assert_array_equal(read_scan(file).points, POINTS)


@pytest.fixture
def drive(tmp_path):
    return write_bag(
        tmp_path / "drive.bag", {"/front": [POINTS, POINTS + 1, POINTS + 2], "/rear": [POINTS + 9]}
    )


@pytest.mark.parametrize(("part", "offset"), [("/front:0", 0), ("/front:2", 2), ("/rear", 9), ("/rear:0", 9)])
def test_one_cloud_of_many_is_named_by_topic_and_number(drive, part, offset):
    np.testing.assert_array_equal(read_scan(f"{drive}#{part}").points, POINTS + offset)


def test_a_number_is_enough_where_there_is_one_topic(tmp_path):
    path = write_bag(tmp_path / "a.bag", {"/points": [POINTS, POINTS + 1]})
    np.testing.assert_array_equal(read_scan(f"{path}#1").points, POINTS + 1)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (
            "",
            r"expected a topic with point clouds, as in drive\.bag#/front:0; found ''.*3 on /front, 1 on /rear",
        ),
        ("1", r"expected a topic"),
        ("/side", r"found '/side'"),
        ("/front", r"from 0 to 2, as in drive\.bag#/front:0; found '/front'"),
        ("/front:3", r"from 0 to 2"),
        ("/front:x", r"from 0 to 2"),
    ],
)
def test_a_cloud_that_is_not_plain_from_the_bag_is_refused(drive, part, message):
    with pytest.raises(InputError, match=message):
        read_scan(f"{drive}#{part}" if part else drive)


def test_a_damaged_bag_is_refused(drive):
    drive.write_bytes(drive.read_bytes()[:200])
    with pytest.raises(InputError, match="rosbags cannot read the bag"):
        read_scan(f"{drive}#/rear")


def test_a_manifest_may_name_scans_inside_files(drive, survey):
    manifest = survey.parent / "pairs.csv"
    manifest.write_text(
        "name,reference,current\nstations,survey.e57#0,survey.e57#1\nfront,drive.bag#/front:0,drive.bag#/front:2\n"
    )
    stations, front = read_pairs(manifest)
    assert stations.load().current.num_points == 2
    np.testing.assert_array_equal(front.load().current.points, POINTS + 2)
    assert stations.files() == (survey, survey)
