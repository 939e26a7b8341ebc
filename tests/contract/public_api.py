"""The recorded listing of the public API. `python -m tests.contract.public_api` records what is there now."""

import ast
import contextlib
import dataclasses
import functools
import inspect
import re
import sys
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path
from typing import Any

import pointit
from pointit import commands, errors, plugins, testing
from pointit.api.feed import Feed, Latest, Newest
from pointit.api.inputs import Tracker
from pointit.api.loop_thread import LoopThread
from pointit.api.requests import Lamp
from pointit.api.run import Run
from pointit.api.site import Site
from pointit.api.sync_site import SyncFeed, SyncLatest, SyncNewest, SyncSite, SyncTracker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.config.installed import InstalledGroup

LISTING = Path(__file__).with_name("public_api.txt")
CHANGELOG = Path(__file__).parents[2] / "CHANGELOG.md"
FUNCTIONS = ("connect", "open", "run", "run_virtually")
CLASSES = (
    *(Site, Feed, Latest, Newest, Tracker, Lamp, Run),
    *(SyncSite, SyncFeed, SyncLatest, SyncNewest, SyncTracker),
)
BLOCKS = ("__aenter__", "__enter__", "__getitem__", "__anext__", "__next__")
"""Methods with names of Python's own whose types are part of the API."""
INTERNAL = {"on", "fail"}
"""Methods of `Site` that other modules of the API call; `mkdocs.yml` hides them, too."""


@contextlib.asynccontextmanager
async def in_memory() -> AsyncGenerator[Site]:
    """Yield a site without services."""
    bus = MemoryBus()
    try:
        async with Site.on(bus, WallClock()) as site:
            yield site
    finally:
        await bus.close()


@functools.cache
def sites() -> tuple[Site, SyncSite]:
    """Return a site and its synchronous twin, which are closed."""
    with SyncSite(in_memory(), LoopThread()) as twin:
        return twin._site, twin


def groups_of(site: Site | SyncSite) -> dict[str, Any]:
    """Return the objects of `site` whose methods are requests, by attribute."""
    return {name: value for name, value in vars(site).items() if type(value).__name__.endswith("Requests")}


def listing() -> list[str]:
    """Return one line for each public name: its path, its parameters and its types."""
    lines = [f"pointit.{name}{signature(getattr(pointit, name))}" for name in FUNCTIONS]
    lines += [f"pointit.{name}" for name in ("Site", "SyncSite", "__version__", "errors")]
    for name in errors.__all__:
        bases = ", ".join(base.__name__ for base in getattr(errors, name).__bases__)
        lines.append(f"pointit.errors.{name}({bases})")
    for kind in CLASSES:
        lines += members(kind, kind.__name__)
    lines += ["Site.latest: Latest", "SyncSite.latest: SyncLatest"]
    lines += newest_lines()
    for site in sites():
        for name, group in groups_of(site).items():
            lines.append(f"{type(site).__name__}.{name}: {without_modules(group.__orig_class__)}")
            lines += members(type(group), f"Site.{name}") if isinstance(site, Site) else []
    for module in (commands, plugins, testing):
        for name in module.__all__:
            lines += for_authors(getattr(module, name), f"{module.__name__}.{name}")
    return sorted(lines)


def newest_lines() -> Iterator[str]:
    """Yield the lines of `site.latest`, with the types of its messages."""
    site, twin = sites()
    for name, newest in vars(site.latest).items():
        its_twin = getattr(twin.latest, name)
        assert its_twin._newest is newest
        for kind, each in (("Latest", newest), ("SyncLatest", its_twin)):
            yield f"{kind}.{name}: {type(each).__name__}[{newest._topic.message.__name__}]"


def without_modules(annotation: Any) -> str:
    """Return a type as it is written in a source."""
    return re.sub(r"[\w.]+\.|~", "", inspect.formatannotation(annotation))


def parsed(value: Any) -> ast.stmt:
    """Return the syntax of a class or function, which may be indented and contain text that is not."""
    source = inspect.getsource(value)
    if not source[0].isspace():
        return ast.parse(source).body[0]
    (block,) = ast.parse(f"if True:\n{source}").body
    assert isinstance(block, ast.If)
    return block.body[0]


def for_authors(value: Any, path: str) -> Iterator[str]:
    """Yield the lines of a name for authors of plug-ins; the fields of messages are in the catalogue."""
    if inspect.isfunction(value):
        yield f"{path}{signature(value)}"
        return
    yield path
    if not inspect.isclass(value) or value.__module__.startswith("pointit.schemas"):
        return
    yield from members(value, path)
    is_written = not (dataclasses.is_dataclass(value) or getattr(value, "_is_protocol", False))
    maker = next(base for base in value.__mro__ if "__init__" in vars(base))
    if (maker is value or maker is InstalledGroup) and is_written:  # whose heirs alone have a public name
        yield f"{path}.__init__{signature(value.__init__)}"
    node = parsed(value)
    assert isinstance(node, ast.ClassDef)
    for field in node.body:
        if isinstance(field, ast.AnnAssign) and not (name := ast.unparse(field.target)).startswith("_"):
            default = " = ..." if field.value else ""
            yield f"{path}.{name}: {ast.unparse(field.annotation)}{default}"


def members(kind: Any, path: str) -> Iterator[str]:
    """Yield a line for each public member of `kind`."""
    ours = [base for base in kind.__mro__ if base.__module__.startswith("pointit.")]
    for name, value in inspect.getmembers(kind):
        if (kind is Site and name in INTERNAL) or (name.startswith("_") and name not in BLOCKS):
            continue
        if name.startswith("test_"):  # a promise of a plug-in, which grows like a message's fields
            continue
        if not any(name in vars(base) for base in ours):  # such as those of `Mapping`
            continue
        if isinstance(value, property):
            assert value.fget is not None
            yield f"{path}.{name}: {signature(value.fget).partition(' -> ')[2]}"
        elif inspect.isfunction(value) and value.__name__ == name:  # a default may be a function, too
            yield f"{path}.{name}{signature(value)}"


def signature(function: Any) -> str:
    """Return parameters, defaults and types of `function`, types as its source writes them."""
    node = parsed(function)
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
        shown.append(f"{name}: {types.get(name, '')}{default}")
    result = ast.unparse(node.returns).strip("'") if node.returns else ""
    awaited = "async " if isinstance(node, ast.AsyncFunctionDef) else ""
    if hasattr(function, "__wrapped__"):  # of `SyncSite`, by `Site`
        result = without_modules(inspect.signature(function).return_annotation)
        awaited = ""
    return f"({', '.join(shown)}) -> {awaited}{result}"


def changed(before: list[str], now: list[str]) -> set[str]:
    """Return the last part of each name that was added, removed or has another signature.

    Of a class that was added or removed, the names of its members are left out.
    """
    paths = {re.split(r"[(:]", line)[0] for line in set(before) ^ set(now)}
    return {path.rpartition(".")[2] for path in paths if path.rpartition(".")[0] not in paths}


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
