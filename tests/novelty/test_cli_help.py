import importlib
import subprocess
import sys

import pytest

import novelty
from novelty.cli import main

COMMANDS = ("detect", "evaluate", "demo", "simulate", "sweep", "report", "paper", "doctor")


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    return stop.value.code, capsys.readouterr()


def test_help_names_every_command(capsys):
    code, text = run(capsys, "--help")
    assert code == 0
    assert all(command in text.out for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_that_fits_eighty_columns(capsys, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, text = run(capsys, command, "--help")
    assert code == 0
    assert max(len(line) for line in text.out.splitlines()) <= 80


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nfrom novelty.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print('heavy:', sorted({'torch', 'open3d', 'numpy', 'scipy', 'pydantic', 'plotly'} & set(sys.modules)))"
    )
    out = subprocess.check_output([sys.executable, "-c", code], text=True)
    assert out.splitlines()[-1] == "heavy: []"


@pytest.mark.parametrize("name", novelty._PACKAGES)
def test_every_package_that_is_named_exists(name):
    assert name in dir(novelty)
    assert getattr(novelty, name) is importlib.import_module(f"novelty.{name}")


def test_a_package_needs_no_import_of_its_own():
    code = "import novelty\nprint(novelty.sweep.read_rows.__name__, len(novelty.sweep.COLUMNS) > 0)"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).split() == ["read_rows", "True"]


def test_an_unknown_name_is_no_attribute():
    with pytest.raises(AttributeError, match="swep"):
        _ = novelty.swep


def test_importing_novelty_imports_nothing_else():
    code = "import sys\nimport novelty\nprint([name for name in sys.modules if name.startswith('novelty.')])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


def test_version(capsys):
    code, text = run(capsys, "--version")
    assert (code, text.out.strip()) == (0, f"novelty {novelty.__version__}")


def test_an_unknown_command_is_refused(capsys):
    code, text = run(capsys, "detct")
    assert code == 2
    assert "detect" in text.err
