"""Examples in docstrings, which teach what others build on: they run, and print what stands there."""

import doctest
import importlib

import pytest

from tests.architecture import sources

MODULES = [
    sources.module_name(path)
    for path in sources.shipped()
    if ">>> " in sources.text(path) and sources.LAB not in path.parents
]


def test_docstrings_have_examples() -> None:
    assert len(MODULES) >= 7


@pytest.mark.parametrize("name", MODULES)
def test_examples_print_what_the_docstring_shows(name: str) -> None:
    module = importlib.import_module(name)
    results = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert results.attempted > 0
    assert results.failed == 0, "see the output above"
