"""`scripts/house`: no import circle, no crowded folder, and few modules that load Zenoh."""

import importlib.util
import os
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import settings

from tests.architecture.sources import ROOT
from tests.support import there
from tests.support.invoked import python

SCRIPT = ROOT / "scripts/house"


@pytest.fixture(scope="module")
def house() -> ModuleType:
    spec = importlib.util.spec_from_loader("house", SourceFileLoader("house", str(SCRIPT)))
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    there(spec.loader).exec_module(module)
    return module


def test_no_limit_is_exceeded() -> None:
    done = python(SCRIPT, "--limits")
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


TESTS = {
    "test_some.py": """
import pytest

@pytest.fixture
def engine():
    pytest.skip("no engine here")

def test_with_an_engine(engine): ...

@pytest.mark.skipif(True, reason="no engine here, either")
def test_marked(): ...

def test_with_recordings():
    pytest.skip("x.csv is absent; set POINTIT_DATA to the folder with the recordings")

@pytest.mark.xfail(reason="not yet")
def test_expected_to_fail():
    raise AssertionError

def test_sound(): ...
""",
    "test_module.py": 'import pytest\npytest.skip("no module here", allow_module_level=True)\n',
}


def test_only_listed_reasons_are_taken(tmp_path: Path) -> None:
    for name, text in TESTS.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-rfE", "-c", f"{tmp_path}/pytest.ini", f"{tmp_path}"]
    done = subprocess.run(
        [*command, "-p", "tests.support.strict_skips", "--continue-on-collection-errors"],
        cwd=ROOT, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
    )  # fmt: skip
    assert done.returncode == 1
    assert "1 passed, 1 skipped, 1 xfailed" in done.stdout
    assert "no engine here; that is no reason listed" in done.stdout
    assert "no engine here, either; that is no reason" in done.stdout
    assert "no module here; that is no reason" in done.stdout


def test_no_property_is_judged_by_how_fast_this_machine_is() -> None:
    assert there(settings.default).deadline is None
