"""The table of age limits has all limits of the code, with their values and files."""

import ast
import importlib
import inspect
import re
from typing import Any

import pytest
from pydantic import BaseModel

from tests.architecture import sources
from tests.architecture.sources import ROOT

PAGE = (ROOT / "docs/reference/ages.md").read_text(encoding="utf-8")
ROWS = re.findall(r"(?m)^\|[^|]+\|[^|]+\| ([\d.]+) s[^|]*\| \[[^\]]+\]\(../../([\w/.]+)\), `(\w+)` \|$", PAGE)
CONSTANT = re.compile(r"MAX_(?:\w+_)?AGE_N?S")
OTHER_WORDS = re.compile(r"(?:FRESH|STALE|OLDEST)(?:_\w+)?_N?S|(?!MAX_)\w+_AGE_N?S")


def constants() -> set[tuple[str, str]]:
    """Return file and name of all constants of the product."""
    return {
        (sources.shown(path), target.id)
        for path in sources.shipped()
        for node in sources.tree(path).body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def value_s(file: str, name: str) -> float:
    """Return the value of a constant, or the default of a parameter or field, s."""
    package = "" if file.startswith("pointit/") else "pointit."
    module = importlib.import_module(package + file.removesuffix(".py").replace("/", "."))
    if name.isupper():
        return getattr(module, name) / (1e9 if name.endswith("_NS") else 1)
    owners: list[Any] = [
        kind
        for _, kind in inspect.getmembers(module, inspect.isclass)
        if kind.__module__ == module.__name__ and name in inspect.get_annotations(kind)
    ]
    (owner,) = owners
    return owner.model_fields[name].default if issubclass(owner, BaseModel) else getattr(owner, name)


@pytest.mark.parametrize(("limit_s", "file", "name"), [pytest.param(*row, id=row[2]) for row in ROWS])
def test_a_row_has_the_value_of_the_code(limit_s: str, file: str, name: str) -> None:
    assert value_s(file, name) == float(limit_s)


def test_every_limit_of_the_code_has_a_row() -> None:
    assert len(ROWS) == PAGE.count("\n| ") - 1 > 30
    limits = {each for each in constants() if CONSTANT.fullmatch(each[1])}
    assert limits == {(file, name) for _, file, name in ROWS if name.isupper()}


def test_limits_of_age_have_one_word() -> None:
    assert not [each for each in constants() if OTHER_WORDS.fullmatch(each[1])]
