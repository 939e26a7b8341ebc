"""`scripts/house`: no import circle, no crowded folder, and few modules that load Zenoh."""

import importlib.util
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

import pytest

from tests.architecture.sources import ROOT

SCRIPT = ROOT / "scripts/house"


@pytest.fixture(scope="module")
def house() -> ModuleType:
    spec = importlib.util.spec_from_loader("house", SourceFileLoader("house", str(SCRIPT)))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_no_limit_is_exceeded() -> None:
    done = subprocess.run([sys.executable, SCRIPT, "--limits"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("  limit ") == 5


def test_limit_of_the_core_never_rises(house: ModuleType) -> None:
    assert house.MOST_CORE <= 42_000


def test_rooms_are_told_apart_by_whole_names(house: ModuleType) -> None:
    assert house.is_below("pointit.a.b", ["pointit.a"])
    assert house.is_below("pointit.a", ["pointit.a"])
    assert not house.is_below("pointit.ab", ["pointit.a"])


def test_import_circle_is_found(house: ModuleType) -> None:
    assert house.circle({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert set(house.circle({"a": {"b"}, "b": {"c"}, "c": {"b"}})) == {"b", "c"}


def test_files_are_counted_per_folder_without_init(house: ModuleType) -> None:
    files = [Path("a", name) for name in ("__init__.py", "x.py", "y.py")] + [Path("a/b/z.py")]
    assert house.largest_folder(files) == (2, Path("a"))
