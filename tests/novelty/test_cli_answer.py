"""The answer on terminals of different widths."""

import re
from dataclasses import replace

import numpy as np
import pytest

from novelty.cli.answer import show_answer
from novelty.cli.terminal import out
from novelty.report.tables import object_table
from tests.novelty.report_case import make_pair, make_result


@pytest.fixture(scope="module")
def moved():
    """A hall in map coordinates, in which something was moved: every column there is, at its widest."""
    result = make_result(make_pair(num_points=2000))
    large = {"extent": np.array([14.45, 11.06, 12.92]), "num_points": 133_584, "p_value": 0.000997}
    thing = {**large, "kind": "moved", "counterpart": 0, "motion": np.eye(4), "index": 10}
    sides = []
    for change, where in ((result.added, (512345.67, 5412345.67, 12.34)), (result.removed, (-1.5, 2.0, 0.3))):
        record = replace(change.objects[0], **thing, centroid=np.array(where))
        other = replace(change.objects[0], **large, centroid=np.array(where))
        sides.append(replace(change, objects=(record, other)))
    return replace(result, added=sides[0], removed=sides[1])


def printed(result, width, monkeypatch, capsys):
    monkeypatch.setattr(out, "width", width)
    show_answer(result, "m", {})
    return capsys.readouterr().out


@pytest.mark.parametrize("width", [30, 40, 50, 60, 70, 80, 100, 140])
def test_no_number_of_an_object_is_cut(moved, width, monkeypatch, capsys):
    text = printed(moved, width, monkeypatch, capsys)
    assert "…" not in text
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    words = text.split()
    table = object_table(moved, "m").without("components", "score", "p-value", "centroid")
    for row in table.rows:
        for number in " ".join(row.cells[1:]).split():
            assert number in words or number + ";" in words
    for coordinate in re.findall(r"\S+", "512345.67, 5412345.67, 12.34"):
        assert (coordinate in words or coordinate + ";" in words) or 60 <= width < 80  # left out


def test_a_wide_terminal_shows_every_column(moved, monkeypatch, capsys):
    text = printed(moved, 140, monkeypatch, capsys)
    for column in object_table(moved, "m").without("components").columns:
        assert column.name in text


def test_more_objects_than_are_listed_are_counted(moved, monkeypatch, capsys):
    many = replace(moved, added=replace(moved.added, objects=moved.added.objects * 15))
    assert "and 11 smaller ones" in printed(many, 80, monkeypatch, capsys)
