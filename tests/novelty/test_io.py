"""Reading and writing scans: every format gives back what was written, and damage is named."""

import contextlib
import json
import os
import stat
import sys
import warnings

import laspy
import numpy as np
import open3d
import pytest

from novelty import InputError, MissingDependencyError
from novelty.io import READERS, load_open3d, read_scan, replacing, write_json, write_ply, write_text

POINTS = np.array([[1.5, -2.25, 3], [500_000.123, 460_000.456, 12.789], [0, 0, 0], [-7, 8.5, 9]])
LABELS = np.array([0, 1, 2, 255], np.uint8)
ROWS = "\n".join(" ".join(map(repr, map(float, row))) for row in POINTS)


def write_pcd(
    path, body, encoding, fields="x y z label", sizes="8 8 8 4", types="F F F U", viewpoint="0 0 0"
):
    counts = " ".join("1" for _ in fields.split())
    header = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {types}\nCOUNT {counts}\n"
        f"WIDTH 4\nHEIGHT 1\nVIEWPOINT {viewpoint} 1 0 0 0\nPOINTS 4\nDATA {encoding}\n"
    )
    path.write_bytes(header.encode() + body)
    return path


def write_ply_by_hand(
    path, body, encoding, properties="double x|double y|double z|uchar label", count=4, more=""
):
    lines = "".join(f"property {entry}\n" for entry in properties.split("|"))
    header = f"ply\nformat {encoding} 1.0\ncomment by hand\nelement vertex {count}\n{lines}{more}end_header\n"
    path.write_bytes(header.encode() + body)
    return path


def rows_of(*columns, order="<"):
    kinds = [(f"c{place}", column.dtype.newbyteorder(order)) for place, column in enumerate(columns)]
    rows = np.empty(len(columns[0]), kinds)
    for place, column in enumerate(columns):
        rows[f"c{place}"] = column
    return rows.tobytes()


def numbers(*columns):
    return "".join(
        " ".join(str(value) for value in row) + "\n" for row in zip(*columns, strict=True)
    ).encode()


XYZ = tuple(POINTS.T)


# --- every format


def write_every_format(folder):
    """One file of each format with the same points; those that can carry labels do."""
    labels = LABELS.astype(np.uint32)
    cloud = open3d.t.geometry.PointCloud(open3d.core.Tensor(POINTS))
    cloud.point["label"] = open3d.core.Tensor(LABELS[:, None])
    for name, compressed in (("open3d.pcd", False), ("compressed.pcd", True)):
        open3d.t.io.write_point_cloud(str(folder / name), cloud, compressed=compressed)
    write_pcd(folder / "ascii.pcd", numbers(*XYZ, labels), "ascii")
    write_pcd(folder / "binary.pcd", rows_of(*XYZ, labels), "binary")
    write_ply(folder / "ours.ply", POINTS, label=LABELS)
    open3d.t.io.write_point_cloud(str(folder / "open3d.ply"), cloud)
    write_ply_by_hand(folder / "ascii.ply", numbers(*XYZ, LABELS), "ascii")
    write_ply_by_hand(folder / "big.ply", rows_of(*XYZ, LABELS, order=">"), "binary_big_endian")
    (folder / "plain.xyz").write_text(ROWS)
    (folder / "plain.txt").write_text(f"# made by hand\n\n{ROWS}\n")
    (folder / "commas.csv").write_bytes(
        b"\xef\xbb\xbfX, Y, Z, label\n" + numbers(*XYZ, LABELS).replace(b" ", b", ")
    )
    (folder / "colours.asc").write_bytes(b"//X Y Z R G B\n" + numbers(*XYZ, *([LABELS] * 3)))
    (folder / "counted.pts").write_text(f"4\n{ROWS}\n")
    (folder / "uncounted.pts").write_text(ROWS)
    np.save(folder / "wide.npy", np.column_stack([POINTS, LABELS]))
    np.savez_compressed(folder / "named.npz", points=POINTS, labels=LABELS)
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales = [0.001] * 3
    las = laspy.LasData(header)
    las.xyz = POINTS
    las.write(folder / "scaled.las")
    las.write(folder / "scaled.laz")
    return sorted(folder.iterdir())


WITH_LABELS = {
    "open3d.pcd", "compressed.pcd", "ascii.pcd", "binary.pcd", "ours.ply", "open3d.ply", "ascii.ply",
    "big.ply", "commas.csv", "named.npz",
}  # fmt: skip


def test_every_format_gives_back_points_order_and_labels(tmp_path):
    files = write_every_format(tmp_path)
    assert {file.suffix for file in files} == set(READERS) - {".bin"}  # float32, see test_io_sequence.py
    for file in files:
        scan = read_scan(file)
        np.testing.assert_allclose(scan.points, POINTS, atol=1e-9, rtol=0, err_msg=file.name)
        assert scan.name == str(file)
        assert scan.origin is None
        if file.name in WITH_LABELS:
            np.testing.assert_array_equal(scan.labels, LABELS, err_msg=file.name)
        else:
            assert scan.labels is None, file.name


def test_extensions_may_be_in_capitals(tmp_path):
    (tmp_path / "SCAN.XYZ").write_text(ROWS)
    assert read_scan(tmp_path / "SCAN.XYZ").num_points == 4


def test_missing_returns_keep_their_place(tmp_path):
    points = POINTS.copy()
    points[1] = np.nan
    points[2, 0] = np.inf
    columns = tuple(points.T)
    write_ply(tmp_path / "a.ply", points)
    write_pcd(tmp_path / "a.pcd", numbers(*columns, LABELS), "ascii")
    write_pcd(tmp_path / "b.pcd", rows_of(*columns, LABELS.astype("u4")), "binary")
    cloud = open3d.t.geometry.PointCloud(open3d.core.Tensor(points))
    open3d.t.io.write_point_cloud(str(tmp_path / "c.pcd"), cloud, compressed=True)
    (tmp_path / "a.xyz").write_bytes(numbers(*columns))
    for file in tmp_path.iterdir():
        np.testing.assert_array_equal(read_scan(file).points, points, err_msg=file.name)


# --- origins


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_the_viewpoint_of_a_pcd_is_the_origin(tmp_path, encoding):
    labels = LABELS.astype("u4")
    body = numbers(*XYZ, labels) if encoding == "ascii" else rows_of(*XYZ, labels)
    file = write_pcd(tmp_path / "a.pcd", body, encoding, viewpoint="1 2 -3.5")
    np.testing.assert_array_equal(read_scan(file).origin, [1, 2, -3.5])
    np.testing.assert_array_equal(read_scan(file, origin=[4, 5, 6]).origin, [4, 5, 6])


def test_a_viewpoint_of_zeros_is_unknown_unless_given(tmp_path):
    file = write_pcd(tmp_path / "a.pcd", numbers(*XYZ, LABELS), "ascii")
    assert read_scan(file).origin is None
    np.testing.assert_array_equal(read_scan(file, origin=[0, 0, 0]).origin, [0, 0, 0])
    np.testing.assert_array_equal(read_scan(file, origin=[0, 0, 0]).labels, LABELS)


def test_an_npz_may_hold_one_origin_per_point(tmp_path):
    np.savez(tmp_path / "a.npz", points=POINTS, origin=POINTS + 1)
    np.testing.assert_array_equal(read_scan(tmp_path / "a.npz").origin, POINTS + 1)


# --- what other programs write


def test_pcd_padding_counts_and_order_of_fields_are_understood(tmp_path):
    rows = np.zeros(
        4, [("a", "u1", 3), ("z", "f4"), ("b", "u1", 2), ("f", "f4", 33), ("y", "f4"), ("x", "f8")]
    )
    for axis, column in zip("xyz", XYZ, strict=True):
        rows[axis] = column
    header = (
        "VERSION 0.7\nFIELDS _ z _ fpfh y x\nSIZE 1 4 1 4 4 8\nTYPE U F U F F F\nCOUNT 3 1 2 33 1 1\n"
        "WIDTH 2\nHEIGHT 2\nDATA binary\n"
    )
    (tmp_path / "a.pcd").write_bytes(header.encode() + rows.tobytes())
    np.testing.assert_allclose(read_scan(tmp_path / "a.pcd").points, POINTS, rtol=1e-7)


def test_ply_with_mixed_types_windows_line_ends_other_elements_and_faces(tmp_path):
    header = (
        "ply\r\nformat binary_little_endian 1.0\r\nelement camera 2\r\nproperty float f\r\n"
        "element vertex 4\r\nproperty uchar red\r\nproperty float z\r\nproperty float y\r\n"
        "property double x\r\n"
        "element face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n"
    )
    x, y, z = XYZ
    body = b"\0" * 8 + rows_of(LABELS, z.astype("f4"), y.astype("f4"), x) + b"\x03" + b"\0" * 12
    (tmp_path / "a.ply").write_bytes(header.encode() + body)
    np.testing.assert_allclose(read_scan(tmp_path / "a.ply").points, POINTS, rtol=1e-7)


def test_ascii_ply_with_faces_stops_at_the_last_vertex(tmp_path):
    more = "element face 1\nproperty list uchar int vertex_indices\n"
    file = write_ply_by_hand(tmp_path / "a.ply", numbers(*XYZ, LABELS) + b"3 0 1 2\n", "ascii", more=more)
    np.testing.assert_array_equal(read_scan(file).points, POINTS)


def test_a_label_that_means_something_else_is_not_taken_for_ground_truth(tmp_path):
    file = write_ply_by_hand(tmp_path / "a.ply", numbers(*XYZ, [40, 48, 1, 0]), "ascii")
    with pytest.warns(
        UserWarning, match=r"label' holds 0.0, 1.0, 40.0, 48.0; it is not used as ground truth"
    ) as caught:
        assert read_scan(file).labels is None
    assert caught[0].filename == __file__


# --- errors


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.ply", b"", r"the file is empty \(0 bytes\)"),
        ("a.ply", b"solid cube", "expected a PLY file, which begins with 'ply'"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement ver", "no 'end_header'"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex x\nend_header\n",
            "line 3: 'element vertex x' has no place",
        ),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", "line 3"),
        ("a.ply", b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "line 3"),
        ("a.ply", b"ply\nformat weird 1.0\nend_header\n", "format must be one of ascii, .*found 'weird'"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement face 3\nend_header\n", "no element 'vertex'; found face"),
        ("a.pcd", b"# .PCD v0.7\nFIELDS x y z\n", "ends with a line 'DATA'"),
        (
            "a.pcd",
            b"FIELDS x y z\nSIZE 4 4\nTYPE F F F\nPOINTS 1\nDATA ascii\n1 2 3\n",
            "PCD header is damaged",
        ),
        ("a.pcd", b"SIZE 4 4 4\nTYPE F F F\nPOINTS 1\nDATA ascii\n1 2 3\n", r"damaged \('FIELDS'\)"),
        (
            "a.pcd",
            b"FIELDS x\nSIZE 4\nTYPE F\nPOINTS 1\nDATA zip\n1\n",
            "must be one of ascii, .*found 'zip'",
        ),
        (
            "a.pcd",
            b"FIELDS x y\nSIZE 4 4\nTYPE F F\nPOINTS 1\nDATA ascii\n1 2\n",
            "fields x, y and z; found x, y",
        ),
        ("a.pcd", b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 0\nDATA ascii\n", "contains no points"),
        ("a.xyz", b"1 2 3\n4 x 6\n7 8 9\n", "a.xyz, line 2: expected numbers, found 'x'"),
        ("a.xyz", b"# by hand\n1 2 3\n\n4 5\n", "line 4: expected 3 columns as above, found 2"),
        ("a.xyz", b"1 2\n3 4\n", "line 1: expected at least 3 columns"),
        ("a.xyz", b"hello world\n", "line 1: expected numbers, found 'hello'"),
        (
            "a.csv",
            b"# survey\nX [m],Y,Z,label\n1,2,3,0\n",
            r"line 2: .* x, y and z .*, found X \[m\], Y, Z, label\.",
        ),
        ("a.txt", b"east north up\n1 2 3\n", "line 1: .* x, y and z .*, found east, north, up"),
        ("a.xyz", b"1,5 2,5 3,5\n", "line 1: expected numbers, found '5 2'"),
        ("a.xyz", b"\xff\xfe\x00\x80binary", "expected a text file, found binary data"),
        ("a.xyz", b"# nothing but a comment\n", "contains no points"),
        ("a.csv", b"x,y,z,label\n", "contains no points"),
        ("a.pts", b"3\n1 2 3\n4 5 6\n", "cut short: its header announces 3 points, 2 follow"),
        ("a.pts", b"three\n1 2 3\n", "line 1: expected the number of points"),
        ("a.pts", b"1\n1 2\n", "line 2: expected at least 3 columns"),
        ("a.las", b"LASF nonsense", "laspy cannot read the file"),
        ("a.npy", b"nonsense", "numpy cannot read the file"),
        ("a.npz", b"nonsense", "expected an NPZ archive"),
    ],
)
def test_damage_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_scan(tmp_path / name)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_a_file_cut_short_is_never_read_as_a_smaller_scan(tmp_path, rng, share):
    points = rng.normal(size=(500, 3))
    write_ply(tmp_path / "binary.ply", points)
    cloud = open3d.t.geometry.PointCloud(open3d.core.Tensor(points))
    open3d.t.io.write_point_cloud(str(tmp_path / "ascii.ply"), cloud, write_ascii=True)
    open3d.t.io.write_point_cloud(str(tmp_path / "binary.pcd"), cloud)
    open3d.t.io.write_point_cloud(str(tmp_path / "ascii.pcd"), cloud, write_ascii=True)
    open3d.t.io.write_point_cloud(str(tmp_path / "compressed.pcd"), cloud, compressed=True)
    np.save(tmp_path / "a.npy", points)
    np.savez(tmp_path / "a.npz", points=points)
    las = laspy.create(point_format=3, file_version="1.4")
    las.xyz = points
    las.write(tmp_path / "a.las")
    las.write(tmp_path / "a.laz")
    for file in sorted(tmp_path.iterdir()):
        content = file.read_bytes()
        file.write_bytes(content[: int(share * len(content))])
        with pytest.raises(InputError, match=r"cut short|damaged|expected .* columns"):
            read_scan(file)


@pytest.mark.parametrize("extension", [".ply", ".pcd", ".npy", ".npz", ".xyz", ".pts", ".csv"])
def test_any_damage_gives_a_scan_or_an_input_error(tmp_path, rng, extension):
    outcomes = set()
    for file in [file for file in write_every_format(tmp_path) if file.suffix == extension]:
        content = bytearray(file.read_bytes())
        for _ in range(60):
            damaged = content.copy()
            damaged[rng.integers(len(content))] = rng.integers(256)
            file.write_bytes(damaged)
            outcomes.add(outcome_of_reading(file))
    assert outcomes <= {"scan", "input error"}
    assert "input error" in outcomes


def outcome_of_reading(file):
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read_scan(file)
    except InputError:
        return "input error"
    return "scan"


def test_points_that_are_not_coordinates_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((5, 2)))
    np.save(tmp_path / "b.npy", np.array([["x", "y", "z"]]))
    np.save(tmp_path / "c.npy", np.zeros((0, 3)))
    np.savez(tmp_path / "a.npz", xyz=POINTS)
    np.savez(tmp_path / "b.npz", points=POINTS, labels=[0, 1, 2, 3])
    for name, message in {
        "a.npy": r"shape \(N, 3\) or wider; got float64 \(5, 2\)",
        "b.npy": "must hold numbers",
        "c.npy": "contains no points",
        "a.npz": "array named 'points'; found xyz",
        "b.npz": "labels must be 0, 1, 2 or 255",
    }.items():
        with pytest.raises(InputError, match=message):
            read_scan(tmp_path / name)


@pytest.mark.parametrize(
    ("properties", "message"),
    [
        ("double x|double y", "expected the fields x, y and z; found x, y"),
        ("double x|double y|double z|float x", "names a property of 'vertex' twice"),
        ("double x|double y|double z|list uchar int seen", "list properties .* not supported"),
        (
            "double x|double y|double z|float w|float v",
            "line 11: the header announces 5 properties .* found 4",
        ),
        ("double x|double y|double z|float128 w", "line 8: 'property float128 w' has no place"),
    ],
)
def test_a_ply_whose_vertices_cannot_be_understood_is_refused(tmp_path, properties, message):
    body = numbers(*XYZ[: properties.count("double")], *([LABELS] if "double z" in properties else []))
    file = write_ply_by_hand(tmp_path / "a.ply", body, "ascii", properties)
    with pytest.raises(InputError, match=message):
        read_scan(file)


def test_a_path_that_is_not_a_scan_gets_advice(tmp_path):
    (tmp_path / "reference.ply").write_bytes(b"ply")
    (tmp_path / "scan.plyy").write_bytes(b"ply")
    (tmp_path / "notes.docx").write_bytes(b"?")
    (tmp_path / "bare").write_bytes(b"?")
    with pytest.raises(InputError, match=r"no such file\. Did you mean 'reference.ply'\?"):
        read_scan(tmp_path / "refrence.ply")
    with pytest.raises(InputError, match="no such file"):
        read_scan(tmp_path / "nowhere" / "scan.ply")
    with pytest.raises(InputError, match="found a folder"):
        read_scan(tmp_path)
    with pytest.raises(
        InputError, match=r"format '.plyy' is not known; known are .ply, .*Did you mean '.ply'\?"
    ):
        read_scan(tmp_path / "scan.plyy")
    with pytest.raises(InputError, match=r"format '.docx' is not known; known are [^?]*$"):
        read_scan(tmp_path / "notes.docx")
    with pytest.raises(InputError, match="without an extension"):
        read_scan(tmp_path / "bare")


def test_a_machine_without_open3d_is_told_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(MissingDependencyError, match="novelty doctor"):
        load_open3d()


# --- writing


def test_written_properties_keep_type_value_and_nan_here_and_in_open3d(tmp_path):
    properties = {
        "novelty": np.array([True, False, True, False]),
        "state": np.array([0, 1, 4, 255], np.uint8),
        "score": np.array([0.1, np.nan, -np.inf, 3]),
        "score32": np.array([0.1, np.nan, 7, 3], np.float32),
        "component": np.array([-1, 0, 3, 19], np.int32),
    }
    write_ply(tmp_path / "deep" / "a.ply", POINTS, **properties)
    cloud = open3d.t.io.read_point_cloud(str(tmp_path / "deep" / "a.ply"))
    np.testing.assert_array_equal(cloud.point.positions.numpy(), POINTS)
    for name, values in properties.items():
        stored = cloud.point[name].numpy()[:, 0]
        np.testing.assert_array_equal(stored, values)
        assert stored.dtype == (np.uint8 if values.dtype == bool else values.dtype)
    np.testing.assert_array_equal(read_scan(tmp_path / "deep" / "a.ply").points, POINTS)


@pytest.mark.parametrize(
    ("scale", "offset", "stored"),
    [(1, 0, b"float x"), (1, 5e5 + 1e-4, b"double x"), (1e200, 0, b"double x")],
)
def test_coordinates_are_narrow_only_where_nothing_is_lost(tmp_path, rng, scale, offset, stored):
    points = rng.normal(size=(20, 3)).astype(np.float32).astype(np.float64) * scale + offset
    points[3] = np.nan
    write_ply(tmp_path / "a.ply", points)
    assert stored in (tmp_path / "a.ply").read_bytes()
    np.testing.assert_array_equal(read_scan(tmp_path / "a.ply").points, points)


@pytest.mark.parametrize(
    ("points", "properties", "message"),
    [
        (np.zeros((0, 3)), {}, r"got \(0, 3\)"),
        (np.zeros((4, 2)), {}, r"got \(4, 2\)"),
        (POINTS, {"score": np.zeros(3)}, r"'score' must have shape \(4,\); got \(3,\)"),
        (POINTS, {"score": np.zeros(4, np.int64)}, "'score' has type int64; PLY knows bool, int8, uint8"),
        (POINTS, {"score": np.zeros(4, complex)}, "'score' has type complex128"),
        (POINTS, {"x": np.zeros(4)}, "cannot be called 'x'"),
        (POINTS, {"my score": np.zeros(4)}, "cannot be called 'my score'"),
    ],
)
def test_what_a_ply_cannot_hold_is_refused_and_nothing_is_left_behind(tmp_path, points, properties, message):
    with pytest.raises(InputError, match=message):
        write_ply(tmp_path / "a.ply", points, **properties)
    assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_leaves_the_old_file_alone(tmp_path):
    write_text(tmp_path / "a.txt", "old")
    with contextlib.suppress(ZeroDivisionError), replacing(tmp_path / "a.txt") as temporary:
        temporary.write_text("half of the n")
        raise ZeroDivisionError
    assert (tmp_path / "a.txt").read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]
    write_text(tmp_path / "a.txt", "new: ≥ 3 µm")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "new: ≥ 3 µm"


def test_a_result_is_readable_like_any_new_file(tmp_path):
    (tmp_path / "plain").write_text("")
    write_text(tmp_path / "ours", "")
    assert stat.S_IMODE(os.stat(tmp_path / "ours").st_mode) == stat.S_IMODE(
        os.stat(tmp_path / "plain").st_mode
    )


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file/a\.json: the file cannot be written"):
        write_json(tmp_path / "file" / "a.json", {})


def test_json_holds_plain_values_and_null_for_what_is_not_a_number(tmp_path):
    content = {
        "kappa": np.float64(0.5), "mean": np.arange(3.0), "count": np.int64(3), "flag": np.bool_(True),
        "score": [1.5, float("nan"), (float("inf"),)], "path": tmp_path, "none": None,
    }  # fmt: skip
    write_json(tmp_path / "a.json", content)
    assert json.loads((tmp_path / "a.json").read_text()) == {
        "kappa": 0.5, "mean": [0, 1, 2], "count": 3, "flag": True, "score": [1.5, None, [None]],
        "path": str(tmp_path), "none": None,
    }  # fmt: skip


# --- real scans


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "num_points", "num_missing", "has_labels"),
    [
        ("mosd/learn2-learn8/current.ply", 208_535, 0, True),
        ("lidar/source.ply", 69_792, 0, False),
        ("lidar/room_scan1.pcd", 112_586, 0, False),
        ("kinect/office1.pcd", 307_200, 158_232 // 3, False),
    ],
)
def test_real_scans_read_as_open3d_reads_them(data_dir, name, num_points, num_missing, has_labels):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scan = read_scan(data_dir / name)
    cloud = open3d.t.io.read_point_cloud(str(data_dir / name))
    np.testing.assert_array_equal(scan.points, cloud.point.positions.numpy())
    assert scan.num_points == num_points
    assert np.isnan(scan.points).any(axis=1).sum() == num_missing
    assert (scan.labels is not None) == has_labels
    if has_labels:
        np.testing.assert_array_equal(scan.labels, cloud.point["label"].numpy()[:, 0])
