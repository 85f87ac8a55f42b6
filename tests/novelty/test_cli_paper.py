"""`--preset`, and the command that runs the paper's experiments."""

import re

import pytest

from novelty import Config, ConfigError
from novelty.cli import main
from novelty.cli.options import build_config


def test_a_file_changes_the_preset_and_an_assignment_changes_both(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("fit: {n_init: 3}\nstructural_matching: {node_threshold: 5.0}\n", encoding="utf-8")
    config = build_config(
        file, ["structural_matching.node_threshold=6"], "paper", detector="structural_matching"
    )
    expected = Config.preset("paper").replace(
        **{"fit.n_init": 3, "structural_matching.node_threshold": 6.0, "detector": "structural_matching"}
    )
    assert config == expected


def test_without_a_preset_a_file_changes_the_defaults(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("fit: {n_init: 3}\n", encoding="utf-8")
    assert build_config(file, None) == Config.from_yaml(file) == Config().replace(**{"fit.n_init": 3})


def test_an_unknown_preset_is_refused():
    with pytest.raises(ConfigError, match="did you mean 'paper'"):
        build_config(None, None, "papper")


@pytest.mark.parametrize("command", ["detect", "evaluate", "fit", "calibrate"])
def test_commands_that_compare_take_a_preset(capsys, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main([command, "--help"])
    assert "--preset" in capsys.readouterr().out


def test_the_preset_decides_how_scans_are_compared(tmp_path, capsys, rng):
    import numpy as np

    points = rng.uniform(0, 3, (600, 3))
    for name in ("before", "after"):
        np.save(tmp_path / f"{name}.npy", points)
    out = tmp_path / "out"
    arguments = ["detect", str(tmp_path / "before.npy"), str(tmp_path / "after.npy"), "--preset", "paper"]
    with pytest.raises(SystemExit) as stop:
        main([*arguments, "--max-components", "3", "--out", str(out)])
    assert stop.value.code == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "detector greedy_emd" in page
    assert "moments: centroid" in page


def test_paper_prints_every_sentence_with_its_verdict(tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    from types import SimpleNamespace

    import novelty.reproduction as reproduction

    claim = (
        "What was removed is found with the maps exchanged, [whatever] it was that stood there before (4)."
    )
    findings = [
        reproduction.Finding(f"{number}. {claim}", "κ 0.9", "κ 0.8", "κ 0.80 [0.70, 0.90] (> 0.6)", verdict)
        for number, verdict in enumerate(reproduction.Verdict)
    ]
    asked = []

    def reproduce(extent, say):
        asked.append(extent)
        say("removal")
        return SimpleNamespace(findings=findings)

    monkeypatch.setattr(reproduction, "reproduce", reproduce)
    monkeypatch.setattr(reproduction, "write_files", lambda folder, found: None)
    monkeypatch.setattr(reproduction, "write_page", lambda path, *_: path.write_text("page"))
    with pytest.raises(SystemExit) as stop:
        main(["paper", "--fast", "--out", str(tmp_path)])
    assert stop.value.code == 0
    assert asked == [reproduction.FAST]
    *shown, last = capsys.readouterr().out.splitlines()
    assert [line[:9].rstrip() for line in shown if line[0] != " "] == ["agrees", "partly", "differs", "open"]
    assert max(map(len, shown)) <= 80
    told = [" ".join(part.split()) for part in re.split(r"^(?=\S)", "\n".join(shown), flags=re.MULTILINE)[1:]]
    assert told == [f"{finding.verdict} {finding.claim}" for finding in findings]
    assert last == f"Report: {tmp_path / 'paper.html'}"
    assert (tmp_path / "paper.html").exists()
