"""Pytest plugin that changes one line of one module while Python imports it; no file is written.

The mutant comes in the environment variable `POINTIT_MUTANT`, as JSON with `file` (absolute), `line` and
`mutated`; without it no line is changed. Processes that a test starts import the original.
"""

import json
import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

import pytest
from hypothesis import Phase, settings

VARIABLE = "POINTIT_MUTANT"
NOT_IMPORTED = "the test does not import the mutated file"


def mutate(source: str, line: str, mutated: str) -> str:
    """Return `source` with `mutated` in place of `line`, which is given without indentation.

    Raises:
        ValueError: If `source` does not contain `line` exactly once.
    """
    lines = source.splitlines()
    indices = [index for index, text in enumerate(lines) if text.strip() == line]
    if len(indices) != 1:
        raise ValueError(f"line found {len(indices)} times instead of once: {line}")
    (index,) = indices
    text = lines[index]
    indentation = text[: len(text) - len(text.lstrip())]
    lines[index] = indentation + mutated
    return "\n".join(lines) + "\n"


class _MutatingLoader(SourceFileLoader):
    """Loader of one file with one changed line."""

    mutant: dict[str, str]

    def get_code(self, fullname: str) -> CodeType:
        """Compile the changed source, past the bytecode cache in both directions."""
        source = self.get_source(fullname) or ""
        changed = mutate(source, self.mutant["line"], self.mutant["mutated"])
        return compile(changed, self.path, "exec", dont_inherit=True)


class _Finder(MetaPathFinder):
    """Import hook for one file."""

    def __init__(self, mutant: dict[str, str]) -> None:
        self._mutant = mutant
        self._file = Path(mutant["file"]).resolve()
        self.used = False

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.origin is None:
            return None
        origin = Path(spec.origin)
        if origin.name != self._file.name:  # first: to resolve each path would take long
            return None
        if origin.resolve() != self._file:  # `pointit/services` is a link to `services`
            return None
        loader = _MutatingLoader(fullname, spec.origin)
        loader.mutant = self._mutant
        spec.loader = loader
        self.used = True
        return spec


def _install() -> _Finder | None:
    mutant = os.environ.get(VARIABLE)
    if not mutant:
        return None
    finder = _Finder(json.loads(mutant))
    sys.meta_path.insert(0, finder)
    return finder


_finder = _install()  # as soon as pytest imports this plugin: before the first `conftest.py`


def pytest_configure() -> None:
    """Make property tests stop at the first failing example and remember none for later runs."""
    phases = (Phase.explicit, Phase.generate)
    settings.register_profile("mutants", settings.default, phases=phases, database=None)
    settings.load_profile("mutants")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Warn if the mutation had no chance."""
    if _finder is not None and not _finder.used:
        terminalreporter.write_line(NOT_IMPORTED)
