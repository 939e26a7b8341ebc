"""Calls in unit tests that wait for real time or read a real clock, found in syntax trees."""

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.architecture.sources import tree

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
