"""In continuous integration a skip fails unless its reason is on the list."""

import os
import subprocess
import sys
from pathlib import Path

from hypothesis import settings

from tests.architecture.sources import ROOT

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
    assert settings.default is not None
    assert settings.default.deadline is None
