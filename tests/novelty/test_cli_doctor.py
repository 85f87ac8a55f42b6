import importlib
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from novelty.cli import main
from novelty.environment import MODULES, installed_version, versions

PYPROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"


doctor_module = importlib.import_module("novelty.cli.doctor")


def run_doctor(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["doctor"])
    return stop.value.code, capsys.readouterr().out


def test_looks_at_every_dependency_of_the_package():
    needed = tomllib.loads(PYPROJECT.read_text())["project"]["dependencies"]
    names = {requirement.split(">")[0].split("[")[0].strip() for requirement in needed}
    assert names <= set(MODULES)


def test_versions_need_no_import():
    code = "import sys, novelty.environment as e; e.versions(); print({'torch', 'numpy'} & set(sys.modules))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "set()"
    assert versions()["numpy"] == metadata.version("numpy")
    assert installed_version("no-such-distribution") is None


def test_a_complete_installation_is_in_order(capsys):
    code, out = run_doctor(capsys)
    assert code == 0
    assert "Everything novelty needs is here." in out
    assert "CPU threads" in out


def test_names_the_missing_shared_library_and_the_command(capsys, monkeypatch):
    monkeypatch.setattr(
        doctor_module, "_loads", lambda library: library not in ("libGL.so.1", "libusb-1.0.so.0")
    )
    monkeypatch.setattr(doctor_module.shutil, "which", lambda name: f"/usr/bin/{name}")
    code, out = run_doctor(capsys)
    assert code == 1
    assert "libGL.so.1" in out
    assert out.count("sudo apt-get install -y libgl1 libusb-1.0-0") == 1


def test_a_library_that_does_not_import_is_told_with_its_reason(capsys, monkeypatch):
    real = doctor_module.importlib.import_module

    def import_module(name):
        if name == "open3d":
            raise OSError("libGL.so.1: cannot open shared object file: No such file or directory")
        return real(name)

    monkeypatch.setattr(doctor_module.importlib, "import_module", import_module)
    monkeypatch.setattr(doctor_module, "_loads", lambda library: library != "libGL.so.1")
    code, out = run_doctor(capsys)
    assert code == 1
    assert "cannot be imported: libGL.so.1" in out
    assert "libgl1" in out


def test_a_library_that_is_not_installed_comes_with_its_command(capsys, monkeypatch):
    real = doctor_module.installed_version
    monkeypatch.setattr(
        doctor_module, "installed_version", lambda name: None if name == "torch" else real(name)
    )
    code, out = run_doctor(capsys)
    assert code == 1
    assert f"{sys.executable} -m pip install torch" in out


def test_works_where_torch_and_open3d_are_absent():
    code = (
        "import sys; sys.modules['torch'] = sys.modules['open3d'] = None; "
        "from novelty.cli import main; main(['doctor'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "✗ torch" in done.stdout
    assert "Traceback" not in done.stderr
