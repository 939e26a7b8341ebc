"""Declarations of installed plug-ins, read from their source: a listing runs no code of other packages.

What a module states literally is read: constants, names, tuples, classes and their attributes, also through
imports of the same package, and names of PointIt itself.
"""

import ast
import importlib
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any, TypeVar, get_args

from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import Plugin, PluginGroup
from pointit.runtime.service.service import Scope
from pointit.services.service_plugin import SERVICES, ServicePlugin

P = TypeVar("P", bound=Plugin)
PUBLIC = "pointit.plugins"
"""Module of names for plug-ins, which is read, too: it takes as long to import as all kinds of plug-ins."""
_STATEMENTS = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


class UnreadableError(Exception):
    """The source does not state a value literally, or there is no source."""


_UNREADABLE = (UnreadableError, AttributeError, ImportError, LookupError, RecursionError, TypeError)
"""Errors of a source that states something else than expected."""


def read_summary(group: PluginGroup[P], name: str) -> Plugin:
    """Return summary and argument of the plug-in `name`, without its parameters.

    It is imported only if its source does not state them.

    Raises:
        ConfigError: If it is in two packages, or must be imported and cannot be.
    """
    try:
        call = _declaration(group.entry(name), group.type)
        fields = ("summary", "argument", "example", "argument_optional")
        given = {field: call.argument(field) for field in fields if field in call.arguments}
        if "summary" in given and all(isinstance(value, str | bool) for value in given.values()):
            return Plugin(config=Config, **given)
    except _UNREADABLE:
        pass
    return group.get(name)


def read_service(name: str) -> dict[str, Any] | None:
    """Return scope, summary and keys of the installed service `name`, or None if its source lacks one.

    Raises:
        ConfigError: If it is in two packages.
    """
    try:
        call = _declaration(SERVICES.entry(name), ServicePlugin)
        row: dict[str, Any] = {"scope": _attribute(call.argument("make"), "SCOPE"), "extra": ""}
        for field in ("reads", "writes", "serves"):
            rows = call.argument(field) if field in call.arguments else ()
            row[field] = [_attribute(each, "key") for each in rows]
        row["about"] = call.argument("summary")
    except _UNREADABLE:
        return None
    return row if row["scope"] in get_args(Scope) else None


@dataclass(frozen=True)
class _Call:
    """A call in a module. Its arguments are evaluated on demand."""

    function: Any
    module: "_Module"
    arguments: dict[str, ast.expr]

    def argument(self, name: str) -> Any:
        """Return the value of a keyword argument."""
        return self.module.evaluate(self.arguments[name])


@dataclass(frozen=True)
class _Class:
    """A class in a module."""

    node: ast.ClassDef
    module: "_Module"


class _Module:
    """Names of a module by its syntax tree."""

    def __init__(self, name: str) -> None:
        """Read the source of the module `name`.

        Raises:
            UnreadableError: If there is none, it is no Python, or a package that it imports is not installed.
        """
        path = _source_path(name)
        self._top = name.partition(".")[0]
        self._package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        try:
            with warnings.catch_warnings(action="ignore"):  # `"\\d"`: that is for its author
                body = ast.parse(path.read_bytes()).body
        except (OSError, SyntaxError, ValueError, MemoryError) as error:  # too deep
            raise UnreadableError(name) from error
        self._values: dict[str, Any] = {}
        self._imports: dict[str, tuple[str, str]] = {}
        for node in body:
            self._add(node)

    def _add(self, node: ast.stmt) -> None:
        if isinstance(node, ast.ImportFrom | ast.Import):
            for name, source in _imported(node, self._package):
                if _spec(source[0].partition(".")[0]) is None:
                    raise UnreadableError(source[0])
                self._imports[name] = source
        elif isinstance(node, _STATEMENTS):
            self._values[node.name] = node
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            self._values[node.targets[0].id] = node.value
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            self._values[node.target.id] = node.value
        else:  # names that depend on what the module does
            for part in ast.walk(node):
                if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                    self._values[part.id] = None
                elif isinstance(part, ast.alias):
                    self._values[part.asname or part.name] = None

    def value(self, name: str) -> Any:
        """Return the value of a name of the module."""
        node = self._values.get(name)
        if isinstance(node, ast.ClassDef):
            return _Class(node, self)
        if isinstance(node, ast.expr):
            return self.evaluate(node)
        if name in self._values or name not in self:
            raise UnreadableError(name)
        module, attribute = self._imports[name]
        top = module.partition(".")[0]
        if top == "pointit" and module != PUBLIC:
            ours = importlib.import_module(module)
            return getattr(ours, attribute) if attribute else sys.modules[top if name == top else module]
        if top not in (self._top, "pointit"):
            raise UnreadableError(name)
        loaded = _Module(module)
        if not attribute:
            return loaded
        return loaded.value(attribute) if attribute in loaded else _Module(f"{module}.{attribute}")

    def __contains__(self, name: str) -> bool:
        return name in self._values or name in self._imports

    def evaluate(self, node: ast.expr) -> Any:
        """Return the value of an expression: a constant, an object of PointIt, a call, a class or texts."""
        match node:
            case ast.Constant():
                return node.value
            case ast.Name():
                return self.value(node.id)
            case ast.Subscript():  # a generic class
                return self.evaluate(node.value)
            case ast.Attribute():
                return _attribute(self.evaluate(node.value), node.attr)
            case ast.Call(args=[]):
                given = {each.arg: each.value for each in node.keywords if each.arg is not None}
                if len(given) == len(node.keywords):
                    return _Call(self.evaluate(node.func), self, given)
            case _:
                return self._evaluate_parts(node)
        raise UnreadableError(ast.dump(node))

    def _evaluate_parts(self, node: ast.expr) -> Any:
        match node:
            case ast.Tuple() | ast.List():
                return tuple(self.evaluate(item) for item in node.elts)
            case ast.BinOp(op=ast.Add()):
                both: list[Any] = [self.evaluate(node.left), self.evaluate(node.right)]
                if {type(each) for each in both} in ({str}, {tuple}):
                    return both[0] + both[1]
            case ast.JoinedStr():
                return "".join(str(self.evaluate(part)) for part in node.values)
            case ast.FormattedValue(format_spec=None, conversion=-1):
                return self.evaluate(node.value)
            case _:
                pass
        raise UnreadableError(ast.dump(node))


def _attribute(owner: Any, name: str) -> Any:
    """Return an attribute of the value `owner` of an expression."""
    if isinstance(owner, _Module):
        return owner.value(name)
    if isinstance(owner, _Call):
        return owner.argument(name)
    if not isinstance(owner, _Class):
        return getattr(owner, name)
    for node in owner.node.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            value: ast.expr | None = getattr(node, "value", None)
            return owner.module.evaluate(value or ast.Name(""))  # none: an annotation
    if not owner.node.bases:
        raise UnreadableError(name)
    return _attribute(owner.module.evaluate(owner.node.bases[0]), name)


def _declaration(entry: EntryPoint, kind: type[Plugin]) -> _Call:
    """Return the call that makes the plug-in of `entry`.

    Raises:
        UnreadableError: If the source does not have it.
    """
    found = _Module(entry.module).value(entry.attr)
    if isinstance(found, _Call) and isinstance(found.function, type) and issubclass(found.function, kind):
        return found
    raise UnreadableError(entry.value)


def _imported(node: ast.Import | ast.ImportFrom, package: str) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield the names that a statement imports, each with its module and its attribute, or `""`."""
    for alias in node.names:
        if isinstance(node, ast.Import):
            module = alias.name if alias.asname else alias.name.partition(".")[0]
            yield alias.asname or module, (module, "")
        else:
            module = resolve_name("." * node.level + (node.module or ""), package)
            yield alias.asname or alias.name, (module, alias.name)


def _spec(top: str) -> ModuleSpec | None:
    """Return the spec of a package that is no part of another, which imports nothing."""
    try:
        return find_spec(top)
    except ValueError:  # loaded without a spec, such as `__main__`
        return None


def _source_path(name: str) -> Path:
    """Return the file of a module, without importing its packages."""
    top, *parts = name.split(".")
    spec = _spec(top)
    folders = [Path(folder) for folder in (spec and spec.submodule_search_locations) or ()]
    paths = [Path(spec.origin)] if spec is not None and spec.origin and not parts else []
    paths += [
        path
        for folder in folders
        for path in (folder.joinpath(*parts, "__init__.py"), folder.joinpath(*parts).with_suffix(".py"))
    ]
    for path in paths:
        if path.suffix == ".py" and path.is_file():
            return path
    raise UnreadableError(name)
