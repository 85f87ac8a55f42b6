import json
import re
from dataclasses import replace

import numpy as np
import pytest

from novelty.cli.answer import show_answer
from novelty.errors import InputError
from novelty.evaluation import evaluate_labels
from novelty.report import Run, evidence, headline, notes, result_record, unseen, write_outputs, write_report
from novelty.report.frame import Frame
from novelty.report.tables import number, object_table, probability, score_table
from novelty.report.views import SIGMAS, STATES, mdl_figure, scan_figure
from novelty.result import PointState, ResultStatus
from novelty.scan import AMBIGUOUS, Scan
from tests.novelty.report_case import SETTINGS, make_pair, make_result, unpack

RUN = Run(SETTINGS, "novelty detect before.ply after.ply --out out")


@pytest.fixture(scope="module")
def case():
    pair = make_pair()
    return pair, make_result(pair, message="current scan: 7 points are not finite.\n<b>not markup</b>")


def scores_of(pair, result):
    return {
        "added": evaluate_labels(pair.current.labels, result.added.point_labels),
        "removed": evaluate_labels(pair.reference.labels, result.removed.point_labels),
    }


def figures_of(path):
    return json.loads(
        re.search(r'<script type="application/json" id="figures">(.*?)</script>', path.read_text()).group(1)
    )


class TestHeadline:
    def test_counts_what_was_added_and_removed(self, case):
        assert headline(case[1]) == "Changed: 1 object added, 1 removed"

    def test_says_that_nothing_changed(self, case):
        assert headline(make_result(case[0], changed=False)) == "No change found"

    def test_does_not_claim_sameness_without_an_answer(self, case):
        failed = replace(case[1], changed=False, status=ResultStatus.FAILED)
        assert headline(failed) == "No answer"


def unseen_case(pair, hidden, outside):
    """A result that found no change, with so many points of the reference scan out of the current one's sight."""
    result = make_result(pair, changed=False)
    states = result.removed.point_states.copy()
    states[:hidden], states[hidden : hidden + outside] = PointState.OCCLUDED, PointState.UNOBSERVED
    return replace(result, removed=replace(result.removed, point_states=states))


class TestUnseen:
    @pytest.mark.parametrize(
        ("hidden", "outside", "sentence"),
        [
            (0, 1320, "1 320 points of the reference scan (20 %) have no counterpart, but the current scan saw "
             "nothing there."),
            (660, 0, "660 points of the reference scan (10 %) have no counterpart, but the current scan saw "
             "something in front of them."),
            (300, 1020, "1 320 points of the reference scan (20 %) have no counterpart, but the current scan saw "
             "nothing there (1 020) or something in front of them (300)."),
        ],
    )  # fmt: skip
    def test_a_large_share_that_was_not_judged_is_told(self, case, tmp_path, hidden, outside, sentence):
        pair, result = case[0], unseen_case(case[0], hidden, outside)
        assert unseen(result) == [sentence]
        assert headline(result) == "No change found where both scans saw"
        record = result_record(pair, result, RUN, {})
        assert record["unseen"] == [sentence]
        assert (record["removed"]["points_occluded"], record["removed"]["points_unobserved"]) == (
            hidden,
            outside,
        )
        assert record["added"]["points_occluded"] == record["added"]["points_unobserved"] == 0
        write_report(tmp_path / "report.html", pair, result, RUN)
        assert sentence in (tmp_path / "report.html").read_text()

    def test_a_few_points_are_not_worth_a_sentence(self, case):
        result = unseen_case(case[0], 100, 100)
        assert unseen(result) == []
        assert headline(result) == "No change found"

    def test_the_terminal_tells_it_under_the_headline(self, case, capsys):
        show_answer(unseen_case(case[0], 0, 1320), "m", {})
        first, *rest = " ".join(capsys.readouterr().out.split()).split("p-value")
        assert first == "No change found where both scans saw "
        assert "the current scan saw nothing there" in rest[0]


class TestNotes:
    def test_what_holds_for_both_scans_is_said_once(self, case):
        message = (
            "reference scan: it is small\n  reference scan: it is odd\n\ncurrent scan: it is old\n"
            "current scan: it is small\nvisibility: none"
        )
        assert notes(replace(case[1], message=message)) == [
            "both scans: it is small",
            "reference scan: it is odd",
            "current scan: it is old",
            "visibility: none",
        ]


class TestFrame:
    def test_keeps_equal_scales(self):
        scene = Frame.around([make_pair().reference.points]).layout("m")
        per_unit = [
            scene["aspectratio"][axis] / np.ptp(scene[f"{axis}axis"]["range"]) for axis in ("x", "y", "z")
        ]
        np.testing.assert_allclose(per_unit, per_unit[0])

    def test_hides_a_ceiling_but_not_an_open_scene(self):
        points = make_pair().reference.points
        assert 2.0 < Frame.around([points]).top < 2.45
        below = points[points[:, 2] < 2.0]
        assert Frame.around([below]).top > below[:, 2].max()

    def test_knows_a_depth_camera_by_its_cone(self, rng):
        depth = rng.uniform(0.5, 3.0, 5000)
        points = np.stack([0.5 * depth * rng.uniform(-1, 1, 5000), 0.4 * depth, depth], axis=1)
        assert Frame.around([points]).depth_camera
        assert not Frame.around([points[:, [2, 0, 1]]]).depth_camera

    def test_shifts_far_coordinates_to_where_float32_is_exact(self):
        pair = make_pair(shift=(5e5, 4e6, 120.0))
        frame = Frame.around([pair.reference.points, pair.current.points])
        assert np.abs(frame.low).max() < 200
        assert frame.shift[0] == np.round(frame.shift[0]) > 4e5

    def test_survives_scans_without_a_finite_point(self):
        frame = Frame.around([np.full((3, 3), np.nan)])
        assert np.isfinite(frame.low).all()
        assert (frame.high > frame.low).all()


@pytest.fixture(scope="module")
def traces(case):
    pair, result = case
    frame = Frame.around([pair.reference.points, pair.current.points])
    return scan_figure(pair.current, result.added, "added", frame, "m")["data"]


class TestScanFigure:
    def test_shows_every_state_by_its_count(self, traces, case):
        names = [trace["name"] for trace in traces if trace["meta"]["layer"] == "points"]
        novel = case[1].added.point_labels.sum()
        assert f"added ({novel} points)" in names
        assert not any("not examined" in name for name in names), "missing returns have no place to be drawn"

    def test_ellipsoids_lie_at_one_and_a_half_sigma(self, traces, case):
        meshes = [trace for trace in traces if trace["type"] == "mesh3d"]
        records = case[1].added.components
        assert len(meshes) == len(records)
        for mesh, record in zip(meshes, records, strict=True):
            offsets = np.stack([unpack(mesh[axis]) for axis in "xyz"], axis=1) - record.mean
            distances = np.sqrt(np.einsum("nd,nd->n", offsets @ np.linalg.inv(record.covariance), offsets))
            np.testing.assert_allclose(distances, SIGMAS, rtol=1e-2)

    def test_boxes_hold_their_object(self, traces, case):
        record = case[1].added.objects[0]
        (box,) = [trace for trace in traces if trace["meta"]["layer"] == "objects"]
        low, high = record.center - record.extent / 2, record.center + record.extent / 2
        drawn = np.stack([unpack(box[axis]) for axis in "xyz"], axis=1)
        np.testing.assert_allclose(np.nanmin(drawn, axis=0), low, rtol=1e-5)
        np.testing.assert_allclose(np.nanmax(drawn, axis=0), high, rtol=1e-5)

    def test_thins_large_scans_evenly(self):
        pair = make_pair(num_points=60_000)
        result = make_result(pair)
        frame = Frame.around([pair.current.points])
        data = scan_figure(pair.current, result.added, "added", frame, "m")["data"]
        (unchanged,) = [trace for trace in data if trace["name"].startswith("unchanged")]
        assert len(unpack(unchanged["x"])) == STATES[PointState.UNCHANGED].most
        rows = pair.current.points[result.added.point_states == 0]
        shares = [(unpack(unchanged["z"]) > 2.4).mean(), (rows[:, 2] > 2.4).mean()]
        assert shares[0] == pytest.approx(shares[1], abs=0.01)

    def test_one_legend_entry_per_group(self, traces):
        groups = [trace["legendgroup"] for trace in traces if trace["showlegend"]]
        assert sorted(groups) == sorted({trace["legendgroup"] for trace in traces})


def test_mdl_figure_marks_the_least_value_and_skips_orders_never_reached(case):
    line, marker = mdl_figure(case[1])["data"][:2]
    assert 4 not in line["x"]
    assert marker["x"] == [9]


def test_mdl_figure_is_absent_without_a_search(case):
    assert mdl_figure(replace(case[1], details={})) is None
    one = {scan: {"mdl_path": [np.nan, 7.0]} for scan in ("reference", "current")}
    assert mdl_figure(replace(case[1], details=one)) is None


def test_object_table_has_a_p_value_column_only_where_a_detector_gives_p_values(case):
    result = case[1]
    objects = tuple(replace(record, p_value=np.nan) for record in result.added.objects)
    added = replace(result.added, objects=objects)
    without = replace(result, added=added, removed=replace(result.removed, objects=()))
    assert "p-value" in [column.name for column in object_table(result, "m").columns]
    assert "p-value" not in [column.name for column in object_table(without, "m").columns]
    assert all(
        len(row.cells) == len(object_table(without, "m").columns) for row in object_table(without, "m").rows
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (float("nan"), "–"),
        (0.0, "0"),
        (1.0, "1.000"),
        (0.4567, "0.457"),
        (1e-9, "1e-09"),
        (1234.5, "1.23e+03"),
    ],
)
def test_numbers_are_short(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (float("nan"), "–"),
        (0.0, "< 1e-16"),
        (1e-17, "< 1e-16"),
        (0.000997, "0.001"),
        (0.04, "0.04"),
        (1.0, "1"),
    ],
)
def test_no_probability_is_zero(value, text):
    assert probability(value) == text


def test_the_table_of_scores_tells_probabilities_as_the_evidence_does(case):
    pair, result = case
    table = score_table(scores_of(pair, result))
    place = [column.name for column in table.columns].index("p value")
    assert [row.cells[place] for row in table.rows] == ["< 1e-16"] * 2
    assert evidence(replace(result, p_value=0.0)) == "p-value < 1e-16"


@pytest.fixture(scope="module")
def path(case, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    pair, result = case
    write_report(path, pair, result, RUN, scores_of(pair, result))
    return path


class TestWriteReport:
    def test_is_one_file_that_needs_no_network(self, path):
        page = path.read_text()
        own = page.replace(re.search(r"<script>.*?plotly\.js v.*?</script>", page, re.DOTALL).group(0), "")
        assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", own)
        assert path.stat().st_size < 8e6

    def test_text_is_escaped(self, path):
        assert "<b>not markup</b>" not in path.read_text()
        assert "&lt;b&gt;not markup" in path.read_text()

    def test_says_how_to_make_it_again(self, path):
        page = path.read_text()
        assert RUN.command in page
        assert "max_components: 20" in page

    def test_carries_strict_json(self, path):
        content = figures_of(path)
        assert set(content["figures"]) == {"added", "removed", "mdl"}
        json.dumps(content, allow_nan=False)

    def test_scores_of_which_none_is_defined_are_no_table(self, case, tmp_path, capsys):
        labels = np.full(case[0].current.num_points, AMBIGUOUS)
        pair = replace(case[0], current=Scan(case[0].current.points, labels=labels))
        scores = {"added": evaluate_labels(labels, case[1].added.point_labels)}
        write_report(tmp_path / "report.html", pair, case[1], RUN, scores)
        assert "ground truth</h2>" not in (tmp_path / "report.html").read_text()
        show_answer(case[1], "m", scores)
        assert "ground truth" not in capsys.readouterr().out
        show_answer(case[1], "m", scores_of(*case))
        assert "ground truth" in capsys.readouterr().out

    def test_without_change_scores_or_path(self, case, tmp_path):
        pair = make_pair(labels=False)
        result = replace(make_result(pair, changed=False), details={})
        write_report(tmp_path / "report.html", pair, result, RUN)
        page = (tmp_path / "report.html").read_text()
        assert "No change found" in page
        assert "ground truth</h2>" not in page


@pytest.fixture(scope="module")
def folder(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("outputs") / "new" / "folder"
    pair, result = case
    write_outputs(folder, pair, result, RUN, scores_of(pair, result))
    return folder


class TestWriteOutputs:
    def test_record_is_strict_json_without_nan(self, folder, case):
        def refuse(constant):
            raise AssertionError(f"{constant} is not JSON")

        record = json.loads((folder / "result.json").read_text(), parse_constant=refuse)
        assert record["answer"] == "Changed: 1 object added, 1 removed"
        assert record["distance"] is None
        assert record["settings"]["max_components"] == 20
        assert record["versions"]["numpy"] == np.__version__
        assert record["scores"]["added"]["kappa"] == pytest.approx(scores_of(*case)["added"].scores.kappa)
        assert len(record["added"]["components"]) == 9
        assert record["added"]["objects"][0]["num_points"] == case[1].added.point_labels.sum()

    def test_scans_carry_the_labels_in_the_order_given(self, folder, case):
        from novelty.io import read_scan

        pair, result = case
        scan = read_scan(folder / "current.ply")
        np.testing.assert_allclose(scan.points, pair.current.points)
        np.testing.assert_array_equal(scan.labels, pair.current.labels)
        header = (folder / "current.ply").read_bytes().split(b"end_header")[0].decode()
        for line in ("uchar novelty", "uchar state", "float score", "int component", "uchar label"):
            assert f"property {line}" in header
        vertex = np.dtype([(n, t) for n, t in _fields(header)])
        rows = np.frombuffer((folder / "current.ply").read_bytes().split(b"end_header\n", 1)[1], vertex)
        np.testing.assert_array_equal(rows["novelty"].astype(bool), result.added.point_labels)
        np.testing.assert_array_equal(rows["state"], result.added.point_states)
        np.testing.assert_array_equal(rows["component"], result.added.point_components)
        np.testing.assert_array_equal(np.isnan(rows["score"]), np.isnan(result.added.point_scores))

    def test_never_writes_over_the_scans_it_speaks_of(self, folder, case):
        from novelty.io import read_scan

        before = (folder / "current.ply").read_bytes()
        pair = replace(case[0], current=read_scan(folder / "current.ply"))
        with pytest.raises(InputError, match=r"current\.ply.*overwrite.*another folder"):
            write_outputs(folder, pair, case[1], RUN)
        assert (folder / "current.ply").read_bytes() == before


def _fields(header):
    types = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4"}
    return [(name, types[kind]) for kind, name in re.findall(r"property (\w+) (\w+)", header)]
