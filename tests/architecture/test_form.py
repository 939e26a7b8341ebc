"""`scripts/house` and `scripts/expression-load` on small examples."""

import importlib.util
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from tests.architecture.sources import ROOT
from tests.support import there

CONSTANTS = """
from os import path
HEAD = 1
def double(x): return 2 * x
MISPLACED = [path, HEAD, *(each for each in "ab")]
DOUBLED = double(2)
LATER = DOUBLED + 1
"""
STATEMENTS = """
def choose(a, b):
    c = a if a and b else [x for x in b if x]
    d, e = a, b
    def inner():
        return b and a
    for each in a or b:
        # a step
        print(each)
"""


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_loader(name, SourceFileLoader(name, str(ROOT / "scripts" / name)))
    module = importlib.util.module_from_spec(there(spec))
    sys.modules[name] = module  # dataclasses look it up
    there(there(spec).loader).exec_module(module)
    return module


def measured(text: str, folder: Path) -> Any:
    path = folder / "example.py"
    path.write_text(text, encoding="utf-8")
    return script("expression-load").measure([path])


def test_import_circle_is_found() -> None:
    house = script("house")
    assert house.circle({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert set(house.circle({"a": {"b"}, "b": {"c"}, "c": {"b"}})) == {"b", "c"}


def test_modules_on_neither_side_of_the_core_are_found() -> None:
    modules = ["pointit.api", "pointit.api.site", "pointit.cli", "pointit.cli.run", "pointit.new"]
    unlisted = script("house").unlisted_modules(modules, ["pointit.api"], ["pointit.cli.run", "pointit.cli"])
    assert unlisted == ["pointit.new"]


def test_constants_below_definitions_are_told_apart(tmp_path: Path) -> None:
    load = measured(CONSTANTS, tmp_path)
    assert [place.rpartition(" ")[2] for place in load.misplaced] == ["MISPLACED"]
    assert [place.rpartition(" ")[2] for place in load.constants_below] == ["DOUBLED", "LATER"]


def test_branches_nodes_and_comments_are_counted(tmp_path: Path) -> None:
    load = measured(STATEMENTS, tmp_path)
    branches = sorted(branches for branches, _, _ in load.statements)
    assert branches == [0, 0, 1, 1, 1, 4], "the inner function counts also in the outer one"
    assert (load.comments, len(load.tuple_assignments)) == (1, 1)


def test_too_many_branches_and_tuple_assignments_are_faults(tmp_path: Path) -> None:
    form = script("expression-load")
    load = measured(STATEMENTS, tmp_path)

    (branches,) = form.faults(load)
    assert branches.startswith("16.7 % of the statements have two branches, limit 2.0 %")

    load.statements = [(0, 1, "place")]
    load.tuple_assignments = ["place: a, b"] * 4
    (tuples,) = form.faults(load)
    assert tuples.startswith("4 assignments of several values, limit 3")
