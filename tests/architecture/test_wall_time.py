"""Calls in unit tests that wait for real time or read a real clock, found in syntax trees."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.architecture.sources import ROOT, tree

SLEEPS = {"asyncio.sleep", "time.sleep"}
IN_LOOPS = {"asyncio.sleep", "tests.support.bench.until"}
"""Take no time in tests without the mark, whose loops are in virtual time."""
WALL = {
    *(f"time.{name}{unit}" for name in ("time", "monotonic", "perf_counter") for unit in ("", "_ns")),
    *(f"tests.support.pace.{name}" for name in ("Patience", "slowness", "within")),
    *("asyncio.run", "time.sleep"),
}
MARK = "pytest.mark.wall_time"


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


LIST = Path(__file__).with_name("wall_time.txt")
MOST = 268
"""Limit of the sum, which only falls."""
UNIT = ROOT / "tests/unit"


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
        "take the time of the loop or of a clock that the test moves; lower fallen counts"
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
