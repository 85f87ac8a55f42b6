"""`novelty doctor`: what is installed, what is missing, and the command that installs it.

It must work where torch and Open3D do not, so it imports every library on its own and under guard.
"""

from __future__ import annotations

import ctypes
import importlib
import shutil
import sys
from dataclasses import dataclass

import typer

from novelty.cli.terminal import out, working
from novelty.environment import MODULES, installed_version

LEAST_PYTHON = (3, 11)

PACKAGE_OF_LIBRARY = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libudev.so.1": "libudev1",
    "libidn2.so.0": "libidn2-0",
    "libgomp.so.1": "libgomp1",
}
"""Shared libraries that Open3D loads, and the Debian package of each."""


@dataclass(frozen=True)
class Finding:
    """One thing looked at: its `name`, what was `found`, and its `remedy`, empty when nothing is wrong."""

    name: str
    found: str
    remedy: str = ""


def doctor() -> None:
    """Say what is installed and what is missing (exit code 1)."""
    with working("Importing every library"):
        findings = [_check_python(), *_check_libraries(), *_check_shared_libraries()]
        devices = _devices()
    _show(findings, devices)
    broken = [finding for finding in findings if finding.remedy]
    if not broken:
        out.print("\n[bold green]Everything novelty needs is here.[/]")
        return
    remedies = list(dict.fromkeys(finding.remedy for finding in broken))
    out.print("\n[bold red]Something is missing.[/] To install it:")
    for remedy in remedies:
        out.print(f"  {remedy}", soft_wrap=True, markup=False)
    raise typer.Exit(1)


def _check_python() -> Finding:
    found = ".".join(str(part) for part in sys.version_info[:3])
    needed = ".".join(str(part) for part in LEAST_PYTHON)
    remedy = "" if sys.version_info >= LEAST_PYTHON else f"install Python {needed} or newer"
    return Finding("python", found, remedy)


def _check_libraries() -> list[Finding]:
    return [_check_library(distribution, module) for distribution, module in MODULES.items()]


def _check_library(distribution: str, module: str) -> Finding:
    version = installed_version(distribution)
    if version is None:
        return Finding(distribution, "not installed", f"{sys.executable} -m pip install {distribution}")
    try:
        importlib.import_module(module)
    except Exception as error:  # whatever a broken installation raises is what has to be told
        reason = f"{version}, cannot be imported: {error}"
        return Finding(distribution, reason, _remedy_of_import(distribution, str(error)))
    return Finding(distribution, version)


def _remedy_of_import(distribution: str, message: str) -> str:
    if any(library in message for library in PACKAGE_OF_LIBRARY) or "cannot open shared object" in message:
        return install_command(_missing_shared_libraries()) or f"install the library named here: {message}"
    return f"{sys.executable} -m pip install --force-reinstall {distribution}"


def _check_shared_libraries() -> list[Finding]:
    if sys.platform != "linux":
        return []
    missing = _missing_shared_libraries()
    if not missing:
        return [Finding("system libraries", f"all {len(PACKAGE_OF_LIBRARY)} that Open3D loads")]
    return [Finding(library, "missing (Open3D loads it)", install_command(missing)) for library in missing]


def _missing_shared_libraries() -> list[str]:
    return [library for library in PACKAGE_OF_LIBRARY if not _loads(library)]


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def install_command(libraries: list[str]) -> str:
    """The command that installs the packages of some shared libraries, empty when there are none."""
    if not libraries:
        return ""
    packages = " ".join(PACKAGE_OF_LIBRARY[library] for library in libraries)
    if shutil.which("apt-get"):
        return f"sudo apt-get install -y {packages}"
    return f"install the packages that Debian calls {packages} with the package manager of this system"


def _devices() -> str:
    try:
        import torch
    except Exception:  # already among the findings
        return ""
    threads = f"{torch.get_num_threads()} CPU threads"
    if not torch.cuda.is_available():
        return f"{threads}, no CUDA device"
    return f"{threads}, CUDA {torch.version.cuda} on {torch.cuda.get_device_name(0)}"


def _show(findings: list[Finding], devices: str) -> None:
    for finding in findings:
        mark = "[red]✗[/]" if finding.remedy else "[green]✓[/]"
        out.print(f"{mark} [bold]{finding.name:<18}[/]", end="")
        out.print(finding.found, markup=False, soft_wrap=True)
    if devices:
        out.print(f"  [bold]{'torch runs on':<18}[/]{devices}")
