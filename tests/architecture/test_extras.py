"""The table of extras names those of pyproject.toml with their libraries, messages how to install them."""

import ast
import contextlib
import re
import tomllib
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from pointit.runtime.host import extras
from pointit.services.registry import PROCESSES
from tests.architecture.sources import ROOT, imports_in, module_name, shipped, tree
from tests.support.invoked import python

PAGE = ROOT / "docs" / "reference" / "extras.md"
INSTALLATION = ROOT / "docs/tutorial/install.md"
"""The page that makes an environment and names its own pip."""
FOR_WORK_ON_POINTIT = {"dev", "docs", "test"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]


def test_table_names_every_extra_with_its_libraries() -> None:
    rows = re.findall(
        r"^\| `([\w-]+)` \| [^|]+ \| ([^|]+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
    documented = {name: set(libraries.split(", ")) for name, libraries in rows}
    declared = {name: {Requirement(line).name for line in lines} for name, lines in EXTRAS.items()}
    assert documented == {name: declared[name] for name in declared.keys() - FOR_WORK_ON_POINTIT}


def test_examples_name_extras_that_there_are() -> None:
    text = PAGE.read_text(encoding="utf-8")
    listed = [*re.findall(r"scripts/setup ([\w -]+)`", text), *re.findall(r"\[([\w,]+)\]", text)]
    assert len(listed) >= 5
    assert {name for names in listed for name in re.split(r"[ ,]", names)} <= {*EXTRAS, "lab"}


def test_no_extra_names_a_repository_package_that_no_index_has() -> None:
    """`pip install` would fetch it from a stranger who has registered the name."""
    laboratory = tomllib.loads((ROOT / "lab/pyproject.toml").read_text(encoding="utf-8"))["project"]["name"]
    needed = {canonicalize_name(Requirement(line).name) for lines in EXTRAS.values() for line in lines}
    lock = (ROOT / "requirements/ci.txt").read_text(encoding="utf-8")
    locked = re.findall(r"^([a-z0-9.-]+)==", lock, re.MULTILINE)
    assert canonicalize_name(laboratory) not in needed
    assert needed - {"pointit"} <= {canonicalize_name(name) for name in locked}


def test_remedy_is_a_script_in_a_checkout_else_pip(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert (extras.CHECKOUT, extras.remedy("web")) == (ROOT, "`scripts/setup web` in the folder of PointIt")
    monkeypatch.setattr(extras, "CHECKOUT", tmp_path)
    remedy = extras.remedy("web")  # by uv where it made the environment
    assert re.search(r"pip install .*'uvicorn>=[\d.]+'", remedy)
    assert "pointit[" not in remedy
    wheel = f"pointit_lab-{PROJECT['version']}-py3-none-any.whl"
    assert f" {wheel}`; `scripts/wheel` makes this file" in extras.remedy("lab")


def test_extras_are_installed_in_one_way_where_people_read() -> None:
    """An environment made by uv has no pip, and a pip found elsewhere installs into another Python."""
    files = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    files += [path for room in ("pointit", "services", "bridges") for path in (ROOT / room).rglob("*.py")]
    named = set[str]()
    for path in set(files) - {PAGE, INSTALLATION, Path(extras.__file__)}:
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"pip install\b.*\bpointit\b|pointit\[", text), path
        named.update(re.findall(r"scripts/setup ([\w-]+)", text))
    assert named <= {*EXTRAS, "lab"}


HARMLESS = ("access", "diagnosis", "geometry", "plugins", "schemas", "sim")
"""Rooms with modules that are all loaded."""


def modules() -> list[str]:
    """Modules of the harmless rooms and of every service, except those that start a process."""
    rooms = ["pointit_lab.evaluation", *(f"pointit.{room}" for room in HARMLESS)]
    rooms += [row.package for row in PROCESSES if row.room == "services"]
    names: list[str] = []
    for path in shipped():
        name = module_name(path)
        if any(name == room or name.startswith(f"{room}.") for room in rooms):
            names.append(name)
    return names


def test_deciding_modules_load_no_zenoh() -> None:
    names = ["pointit.runtime.service.service", *modules()]
    assert {
        "pointit_lab.evaluation.localization.localization",
        "pointit.services.selector.selection_engine",
    } <= set(names)
    script = (
        "import importlib, sys\n"
        "for name in sys.stdin.read().split():\n"
        "    importlib.import_module(name)\n"
        "    if 'zenoh' in sys.modules: sys.exit(f'{name} loads zenoh')\n"
    )
    done = python("-c", script, input="\n".join(names))
    assert done.returncode == 0, done.stderr


def installed_with(lines: list[str]) -> set[str]:
    """Return the distributions that requirements bring, with what these need."""
    found: set[str] = set()
    left = [Requirement(line) for line in lines]
    while left:
        each = left.pop()
        if each.name == "pointit":
            left += [Requirement(line) for extra in each.extras for line in EXTRAS[extra]]
        elif each.name not in found:
            found.add(each.name)
            with contextlib.suppress(PackageNotFoundError):  # of another system
                needed = [Requirement(line) for line in requires(each.name) or ()]
                left += [one for one in needed if one.marker is None or one.marker.evaluate({"extra": ""})]
    return {canonicalize_name(name) for name in found}


def test_modules_that_tests_import_are_installed_by_scripts_test() -> None:
    """Statements count without which a file of tests cannot be loaded."""
    there = installed_with([*PROJECT["dependencies"], *EXTRAS["test"]]) | {"pointit", "pointit-lab"}
    makers = packages_distributions()
    absent: set[tuple[str, str]] = set()
    for path in (each for room in ("unit", "integration") for each in (ROOT / "tests" / room).rglob("*.py")):
        for statement in tree(path).body:
            if isinstance(statement, ast.Import | ast.ImportFrom | ast.Assign | ast.AnnAssign):
                for module, _ in imports_in(statement):
                    by = {canonicalize_name(name) for name in makers.get(module.partition(".")[0], ())}
                    if by and not by & there:
                        absent.add((path.name, module))
    assert not absent
