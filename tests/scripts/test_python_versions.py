"""The scripts and several Pythons: the newest is used, its missing compiler named, others are tested."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.architecture.sources import ROOT
from tests.scripts.machine import PYTHON, UV, Machine

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the scripts are for POSIX shells")


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


@pytest.mark.parametrize("others", [(), ("python3.13", "python3"), ("python3.11",)])
def test_newest_python_makes_the_environment(machine: Machine, others: tuple[str, ...]) -> None:
    for name in ("python3.14", *others):
        machine.add(name, PYTHON)
    machine.add("uv", UV.replace("python3 ", "python3.14 "))
    machine.run("demo", SELF=str(machine.bin / "python3.14"))
    assert machine.calls[0] == f"uv venv --quiet --python {machine.bin}/python3.14 {machine.root}/.venv"


@pytest.mark.parametrize("extra", ["fusion", "speech", "test", "dev", "web"])
def test_missing_compiler_is_named_before_and_after_pip_fails(machine: Machine, extra: str) -> None:
    machine.add("python3", PYTHON)
    options = {"NOT_THERE": "a C++ compiler, Python.h", "NO_NET": "g++: not found", "NO_UV": "1"}
    done = machine.run("setup", extra, **options)
    sentence = (
        "setup: the extras fusion and speech are built for Python 3.14 and newer, and a C++ compiler, "
        "Python.h is missing here; on Debian and Ubuntu: apt install build-essential python3-dev"
    )
    lines = done.stderr.splitlines()
    assert done.returncode == 1
    assert "g++: not found" in lines
    if extra == "web":
        assert sentence not in lines
    else:
        assert (lines[0], lines[-1]) == (sentence, sentence)


def test_compiler_is_looked_for_by_the_python_of_the_environment(machine: Machine) -> None:
    """The real check, in this Python, which has all it needs or is too old to need anything."""
    machine.add("python3", f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    check = "source scripts/lib.sh; PYTHON=python3; missing_for_build fusion; missing_for_build web"
    path = f"{machine.bin}:{os.environ['PATH']}"
    done = subprocess.run(
        [machine.bin / "bash", "-c", check], cwd=machine.root, env={"PATH": path},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == "" == done.stderr


def test_missing_python_is_installed_by_the_tool_or_reported(
    machine: Machine,
) -> None:
    shutil.copytree(ROOT / ".ci", machine.root / ".ci")
    bin_ = machine.root / ".venv" / "bin"
    bin_.mkdir(parents=True)
    (bin_ / "python").symlink_to(sys.executable)
    tool = machine.root.parent / "shared" / "tools" / "python-3.14"
    tool.parent.mkdir(parents=True)
    tool.write_text('#!/bin/sh\necho "tool $*" >> "$CALLS"; echo "no mirror" >&2; exit 1\n', encoding="utf-8")
    tool.chmod(0o755)
    done = machine.run("../.ci/versions")
    assert "tool /opt/python-3.14" in machine.calls
    assert "no mirror" in done.stderr
    assert "absent  python 3.13 is not on this machine: nothing was tested with it" in done.stdout
