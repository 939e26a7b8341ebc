"""The recorded listing of the public API. `python -m tests.contract.public_api` records what is there now."""

import ast
import asyncio
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pointit
from pointit import errors
from pointit.api.feed import Feed
from pointit.api.lamp import Lamp
from pointit.api.latest import Latest, Newest
from pointit.api.run import Run
from pointit.api.site import Site
from pointit.api.sync_site import SyncFeed, SyncSite, SyncTracker
from pointit.api.tracker import Tracker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock

LISTING = Path(__file__).with_name("public_api.txt")
CHANGELOG = Path(__file__).parents[2] / "CHANGELOG.md"
FUNCTIONS = ("connect", "open", "run", "run_virtually")
CLASSES = (Site, SyncSite, Feed, SyncFeed, Latest, Newest, Tracker, SyncTracker, Lamp, Run)
BLOCKS = ("__aenter__", "__enter__", "__getitem__", "__anext__", "__next__")
"""Methods with names of Python's own whose types are part of the API."""
INTERNAL = {"Site": {"on", "fail"}, "Tracker": {"deny"}}
"""Methods that other modules of the API call."""


def groups() -> dict[str, Any]:
    """Return the objects of `Site` whose methods are requests, by attribute."""

    async def made() -> Site:
        bus = MemoryBus()
        try:
            return Site(bus, WallClock())
        finally:
            await bus.close()

    found = vars(asyncio.run(made()))
    return {name: value for name, value in found.items() if type(value).__name__.endswith("Requests")}


def listing() -> list[str]:
    """Return one line for each public name: its path, its parameters and its types."""
    lines = [f"pointit.{name}{signature(getattr(pointit, name))}" for name in FUNCTIONS]
    lines += [f"pointit.{name}" for name in ("Site", "SyncSite", "__version__", "errors")]
    for name in errors.__all__:
        bases = ", ".join(base.__name__ for base in getattr(errors, name).__bases__)
        lines.append(f"pointit.errors.{name}({bases})")
    for kind in CLASSES:
        lines += members(kind, kind.__name__, INTERNAL.get(kind.__name__, set()))
    lines.append("Site.latest: Latest")
    for name, group in groups().items():
        arguments = re.sub(r"[\w.]+\.", "", str(group.__orig_class__))
        lines += [f"Site.{name}: {arguments}", *members(group.__class__, f"Site.{name}", set())]
    return sorted(lines)


def members(kind: Any, path: str, internal: set[str]) -> Iterator[str]:
    """Yield a line for each public member of `kind`."""
    for name, value in inspect.getmembers(kind):
        if name in internal or (name.startswith("_") and name not in BLOCKS):
            continue
        if name not in vars(kind):  # such as those of `Mapping`
            continue
        if isinstance(value, property):
            assert value.fget is not None
            yield f"{path}.{name}: {signature(value.fget).partition(' -> ')[2]}"
        elif inspect.isfunction(value):
            yield f"{path}.{name}{signature(value)}"


def signature(function: Any) -> str:
    """Return parameters, defaults and types of `function`, types as its source writes them."""
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    assert isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    arguments = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
    types = {each.arg: ast.unparse(each.annotation) for each in arguments if each.annotation}
    shown: list[str] = []
    for name, parameter in inspect.signature(function).parameters.items():
        if name == "self":
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and "*" not in shown:
            shown.append("*")
        default = "" if parameter.default is parameter.empty else f" = {parameter.default!r}"
        shown.append(f"{name}: {types[name]}{default}")
    result = ast.unparse(node.returns).strip("'") if node.returns else ""
    awaited = "async " if isinstance(node, ast.AsyncFunctionDef) else ""
    return f"({', '.join(shown)}) -> {awaited}{result}"


def changed(before: list[str], now: list[str]) -> set[str]:
    """Return the last part of each name that was added, removed or has another signature."""
    return {re.split(r"[(:]", line)[0].rpartition(".")[2] for line in set(before) ^ set(now)}


def unmentioned(names: set[str], changelog: str) -> list[str]:
    """Return the `names` that the part `Unreleased` of `changelog` does not mention."""
    unreleased = changelog.partition("## [Unreleased]")[2].partition("\n## [")[0]
    return sorted(name for name in names if not re.search(rf"\b{re.escape(name)}\b", unreleased))


def main() -> None:
    """Record the listing, unless the changelog lacks a change."""
    now = listing()
    if LISTING.exists():
        before = LISTING.read_text(encoding="utf-8").splitlines()
        lacking = unmentioned(changed(before, now), CHANGELOG.read_text(encoding="utf-8"))
        if lacking:
            sys.exit(f"add what changed to CHANGELOG.md, under Unreleased: {', '.join(lacking)}")
    LISTING.write_text("\n".join(now) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
