"""No test waits in vain: skips have listed reasons, unit tests take no real time."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.architecture.sources import ROOT, tree
from tests.support import there

SLEEPS = {"asyncio.sleep", "time.sleep"}
IN_LOOPS = {"asyncio.sleep", "tests.support.bench.until"}
"""Take no time in tests without the mark, whose loops are in virtual time."""
WALL = {
    *(f"time.{name}{unit}" for name in ("time", "monotonic", "perf_counter") for unit in ("", "_ns")),
    *(f"tests.support.pace.{name}" for name in ("Patience", "slowness", "within")),
    *("asyncio.run", "time.sleep"),
}
MARK = "pytest.mark.wall_time"
LIST = Path(__file__).with_name("wall_time.txt")
MOST = 222
"""Limit of the sum, which only falls."""
UNIT = ROOT / "tests/unit"

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


def wall_time_calls(path: Path) -> list[ast.Call]:
    """Return the calls in a module of unit tests that wait for real time or read its clock."""
    names = dict(_names(path))
    nodes = [*ast.walk(tree(path))]
    is_marked = any(_name(node, names) == MARK for node in nodes if isinstance(node, ast.Attribute))
    counted = WALL | IN_LOOPS if is_marked else WALL
    calls = [node for node in nodes if isinstance(node, ast.Call)]
    return [
        call
        for call in calls
        if (name := _name(call.func, names)) in counted and not (name in SLEEPS and _is_zero(call))
    ]


def _names(path: Path) -> Iterator[tuple[str, str]]:
    """Yield what each imported name of a module is, `sleep` is `asyncio.sleep`."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from ((alias.asname or alias.name, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((alias.asname or alias.name, f"{node.module}.{alias.name}") for alias in node.names)


def _name(node: ast.expr, names: dict[str, str]) -> str:
    if isinstance(node, ast.Attribute):
        return f"{_name(node.value, names)}.{node.attr}"
    return names.get(node.id, node.id) if isinstance(node, ast.Name) else ""


def _is_zero(call: ast.Call) -> bool:
    return bool(call.args) and isinstance(call.args[0], ast.Constant) and not call.args[0].value


def listed() -> dict[str, int]:
    rows = (line.split() for line in LIST.read_text(encoding="utf-8").splitlines())
    return {name: int(count) for count, name in rows}


def test_unit_tests_wait_for_no_real_time() -> None:
    """Asynchronous unit tests run in virtual time unless they are marked `wall_time`."""
    found = {
        path.relative_to(UNIT).as_posix(): len(calls)
        for path in sorted(UNIT.rglob("*.py"))
        if (calls := wall_time_calls(path))
    }
    assert found == listed(), (
        "take the time of the loop or of a clock that tests move; a new test with a socket, a thread or a "
        "process stands in tests/integration (docs/how-to/contribute.md); lower counts that have fallen"
    )
    assert sum(found.values()) <= MOST


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("import time\ntime.sleep(0.1)\ntime.monotonic()\n", 2),
        ("from time import sleep as wait\nwait(1)\n", 1),
        ("import time\ntime.sleep(0)\n", 0),
        ("import asyncio\nasync def test_a():\n    await asyncio.sleep(1)\n", 0),
        ("import asyncio\nimport pytest\npytestmark = pytest.mark.wall_time\nasyncio.sleep(1)\n", 1),
        ("import asyncio\nasyncio.run(main())\n", 1),
        ("from tests.support.pace import within\nwithin(1.0, 2.0)\n", 1),
    ],
)
def test_each_way_to_wait_is_found(tmp_path: Path, source: str, count: int) -> None:
    path = tmp_path / "module.py"
    path.write_text(source)
    assert len(wall_time_calls(path)) == count
