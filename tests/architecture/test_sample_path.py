"""The table in docs/explanation/architecture.md that leads through the functions of the path of a sample."""

import ast
import re
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.architecture import sources
from tests.architecture.sources import ROOT

PAGE = ROOT / "docs/explanation/architecture.md"
ROW = re.compile(
    r"^\| \d+\. .* \| `(?P<name>[\w.]+)` of \[.*\]\((?P<path>[\w./]+)\) \| (?P<lines>\d+) \|$", re.MULTILINE
)
SUM = re.compile(r"\*\*(?P<functions>\d+) functions with (?P<lines>\d+) lines together")


class Step(NamedTuple):
    """A row of the table."""

    name: str
    path: Path
    lines: int


STEPS = [
    Step(row["name"], (PAGE.parent / row["path"]).resolve(), int(row["lines"]))
    for row in ROW.finditer(PAGE.read_text(encoding="utf-8"))
]


def line_count(step: Step) -> int:
    """Return the number of lines of the function of `step`, which may be a method: `Class.method`."""
    node: ast.AST = sources.tree(step.path)
    for part in step.name.split("."):
        members = {child.name: child for child in getattr(node, "body", []) if hasattr(child, "name")}
        assert part in members, f"{step.path.relative_to(ROOT)} has no {step.name}: correct {PAGE.name}"
        node = members[part]
    assert isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef), f"{step.name} is no function"
    assert node.end_lineno is not None
    return node.end_lineno - node.lineno + 1


@pytest.mark.parametrize("step", [pytest.param(step, id=step.name) for step in STEPS])
def test_function_of_a_step_has_the_stated_lines(step: Step) -> None:
    assert step.lines == line_count(step), f"correct the row of {step.name} in {PAGE.name}, and the sum above"


def test_steps_are_numbered_and_each_has_one_function() -> None:
    section = PAGE.read_text(encoding="utf-8").partition("## The path of a sample")[2].partition("\n## ")[0]
    numbers = [int(number) for number in re.findall(r"(?m)^\| (\d+)\. ", section)]
    assert numbers == list(range(1, len(STEPS) + 1)), "a row has not the form of the others"


def test_sum_above_the_table_is_that_of_its_rows() -> None:
    stated = SUM.search(PAGE.read_text(encoding="utf-8"))
    assert stated is not None
    lines = sum(step.lines for step in STEPS)
    assert (int(stated["functions"]), int(stated["lines"])) == (len(STEPS), lines)
