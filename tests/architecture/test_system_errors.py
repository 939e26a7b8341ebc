"""Errors of the system have one way into text for people, `system_reason`: none shows `[Errno 111]`."""

import ast
import builtins
from collections.abc import Iterator

import pytest

from tests.architecture.sources import ROOT, shipped, shown, tree

ONE_PLACE = ROOT / "schemas/text.py"
TEMPLATES = ROOT / "pointit/testing/templates"
"""Plug-ins of others, which write their own sentences."""
LOG_METHODS = {"debug", "info", "warning", "error", "critical"}
NO_ANSWER = {"TimeoutError"}
"""Raised by our own code with a sentence, and by the system without text."""


def _error_names(node: ast.expr | None) -> set[str]:
    if isinstance(node, ast.Tuple):
        return {name for element in node.elts for name in _error_names(element)}
    if isinstance(node, ast.Attribute):
        return {node.attr}
    return {node.id} if isinstance(node, ast.Name) else set()


def _is_of_system(name: str) -> bool:
    kind = getattr(builtins, name, None)
    is_os_error = isinstance(kind, type) and issubclass(kind, OSError)
    return name in {"gaierror", "SSLError"} or (is_os_error and name not in NO_ANSWER)


def _shows(node: ast.AST, variable: str) -> bool:
    """Return True if `node` makes text of the error in `variable` by itself."""
    values: list[ast.expr] = []
    if isinstance(node, ast.FormattedValue):
        values = [node.value]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "str":
        values = node.args
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        values = node.args[1:] if node.func.attr in LOG_METHODS else []
    return any(isinstance(value, ast.Name) and value.id == variable for value in values)


def raw_texts(module: ast.Module) -> Iterator[ast.expr | ast.stmt]:
    """Return each place that shows an error of the system in its own words."""
    for node in ast.walk(module):
        if isinstance(node, ast.Attribute) and node.attr == "strerror":
            yield node
        if not isinstance(node, ast.ExceptHandler) or node.name is None:
            continue
        if not any(map(_is_of_system, _error_names(node.type))):
            continue
        for inner in ast.walk(node):
            if isinstance(inner, ast.expr) and _shows(inner, node.name):
                yield inner


def test_errors_of_the_system_are_shown_by_their_reason() -> None:
    sources = [path for path in shipped() if path != ONE_PLACE and not path.is_relative_to(TEMPLATES)]
    found = [shown(path, node) for path in sources for node in raw_texts(tree(path))]
    assert found == [], "use `system_reason` of schemas/text.py"


@pytest.mark.parametrize(
    "statement",
    [
        'fail(f"{path}: {error}")',
        "reason = str(error)",
        'log.warning("no answer: %s", error)',
        "reason = error.strerror",
    ],
)
def test_raw_error_of_the_system_is_found(statement: str) -> None:
    module = ast.parse(f"try:\n    open()\nexcept (ConfigError, PermissionError) as error:\n    {statement}")
    assert [*raw_texts(module)]
