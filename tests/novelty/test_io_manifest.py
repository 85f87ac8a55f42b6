"""`pairs.csv`: what is damaged is named with its line, and one bad pair never stops the others."""

import numpy as np
import pytest

from novelty import InputError
from novelty.io import FailedPair, load_pairs, read_entries, read_pairs
from novelty.scan import ScanPair

HEADER = "name,reference,current,reference_origin,current_origin,unit"


@pytest.fixture
def folder(tmp_path):
    for place, name in enumerate(["before.xyz", "now.xyz", "a,comma.xyz"]):
        (tmp_path / name).write_text(f"{place} 2 3\n4 5 6\n")
    (tmp_path / "broken.xyz").write_text("1 2 3\n4 five 6\n")
    return tmp_path


def manifest(folder, *lines):
    (folder / "pairs.csv").write_text("\n".join(lines) + "\n")
    return folder / "pairs.csv"


def test_every_column_is_read_and_paths_are_relative_to_the_manifest(folder, monkeypatch):
    path = manifest(
        folder,
        HEADER,
        "hall,before.xyz,now.xyz,0 0 1.5,-1e1 2 3,mm",
        "",
        'room, now.xyz ,"a,comma.xyz",,,',
    )
    monkeypatch.chdir("/")
    hall, room = read_pairs(path)
    assert (hall.name, hall.reference, hall.current) == ("hall", folder / "before.xyz", folder / "now.xyz")
    assert (hall.reference_origin, hall.current_origin, hall.unit) == ((0, 0, 1.5), (-10, 2, 3), "mm")
    assert (room.reference_origin, room.current_origin, room.unit) == (None, None, None)
    pair = hall.load()
    assert pair.name == "hall"
    np.testing.assert_array_equal(pair.reference.points, [[0, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(pair.current.origin, [-10, 2, 3])
    assert room.load().current.points[0, 0] == 2
    assert room.load().current.origin is None


def test_columns_may_come_in_any_order_and_a_spreadsheet_may_have_written_them(folder):
    (folder / "pairs.csv").write_bytes(b"\xef\xbb\xbfcurrent,name,reference\r\nnow.xyz,hall,before.xyz\r\n")
    (entry,) = read_pairs(folder / "pairs.csv")
    assert (entry.name, entry.reference.name, entry.current.name) == ("hall", "before.xyz", "now.xyz")


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([""], "the manifest is empty; its first line must be name,reference,current"),
        (["name,reference,current"], "lists no pairs"),
        (["name,reference"], "line 1: the column 'current' is missing; found name, reference"),
        (
            ["name,refrence,current"],
            r"line 1: the column 'refrence' is not known; did you mean 'reference'\?",
        ),
        (["name,reference,current,weather"], "column 'weather' is not known; known are name, "),
        (["name,reference,current,name"], "a column is there twice"),
        (["name;reference;current"], "separated by commas, found semicolons"),
        ([HEADER, "a,before.xyz,now.xyz"], r"line 2: expected 6 fields \(name, .*\), found 3"),
        (
            ["name,reference,current", "a,before.xyz,now.xyz", "", ",before.xyz,now.xyz"],
            "line 4: the field 'name' is",
        ),
        (["name,reference,current", "a,,now.xyz"], "line 2: the field 'reference' is empty"),
        (
            ["name,reference,current", "a,before.xyz,gone.xyz"],
            "line 2: the current scan 'gone.xyz' is not a file",
        ),
        (["name,reference,current", "a,before.xyz,."], "line 2: the current scan '.' is not a file"),
        (
            [HEADER, "a,before.xyz,now.xyz,0 0,,"],
            "line 2: reference_origin must be three numbers .* found '0 0'",
        ),
        ([HEADER, "a,before.xyz,now.xyz,,0 zero 0,"], "line 2: current_origin must be three numbers"),
        ([HEADER, "a,before.xyz,now.xyz,,0 nan 0,"], "line 2: current_origin must be three finite numbers"),
        (
            [
                "name,reference,current",
                "a,before.xyz,now.xyz",
                "b,before.xyz,now.xyz",
                "a,now.xyz,before.xyz",
            ],
            "line 4: the name 'a' is already used on line 2",
        ),
        (["name,reference,current", 'a,"before.xyz,now.xyz'], "expected a CSV file"),
    ],
)
def test_a_damaged_manifest_is_refused_with_the_line(folder, lines, message):
    with pytest.raises(InputError, match=rf"pairs\.csv.*{message}"):
        read_pairs(manifest(folder, *lines))


def test_a_manifest_that_is_not_there_or_not_text_is_refused(folder):
    with pytest.raises(InputError, match="no such manifest"):
        read_pairs(folder / "nowhere.csv")
    with pytest.raises(InputError, match="expected scans whose names end in a number"):
        read_pairs(folder)
    (folder / "pairs.csv").write_bytes(b"\xff\xfe\x80")
    with pytest.raises(InputError, match="expected a CSV file in UTF-8"):
        read_pairs(folder / "pairs.csv")


def test_a_scan_that_cannot_be_read_is_reported_with_the_line_of_the_manifest(folder):
    (entry,) = read_pairs(manifest(folder, "name,reference,current", "a,before.xyz,broken.xyz"))
    with pytest.raises(InputError, match=r"pairs\.csv, line 2: .*broken\.xyz, line 2: .* found 'five'"):
        entry.load()


def test_bad_pairs_are_reported_in_their_place_and_the_others_are_loaded(folder):
    path = manifest(
        folder,
        HEADER,
        "good,before.xyz,now.xyz,,,",
        "missing,before.xyz,gone.xyz,,,",
        "broken,broken.xyz,now.xyz,,,",
        "short,before.xyz",
        "good,now.xyz,before.xyz,,,",
        "fine,now.xyz,before.xyz,0 0 0,,",
    )
    entries, loaded = read_entries(path), list(load_pairs(path))
    assert [isinstance(entry, FailedPair) for entry in entries] == [False, True, False, True, True, False]
    assert [entry.name for entry in entries] == [pair.name for pair in loaded]
    assert [pair.name for pair in loaded] == ["good", "missing", "broken", "line 5", "good", "fine"]
    assert [type(pair) for pair in loaded] == [ScanPair, *[FailedPair] * 4, ScanPair]
    for line, pair in enumerate(loaded, start=2):
        if isinstance(pair, FailedPair):
            assert f"pairs.csv, line {line}" in str(pair.error)


def test_a_header_that_cannot_be_understood_stops_the_batch(folder):
    with pytest.raises(InputError, match="line 1"):
        list(load_pairs(manifest(folder, "name,before,after", "a,before.xyz,now.xyz")))


@pytest.mark.data
def test_the_real_pairs_are_read_with_labels_and_origins(data_dir):
    entries = read_pairs(data_dir / "mosd" / "pairs-tune.csv")
    assert [entry.name for entry in entries] == ["learn2-learn8", "learn6-learn7", "learn9-learn10"]
    pair = entries[0].load()
    np.testing.assert_array_equal(pair.current.origin, [0, 0, 0])
    assert np.bincount(pair.current.labels)[1] == 29_503
