"""The sources under test: files and their content."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINKS = ("services", "schemas", "bridges")
"""Rooms that stand beside the package, which links to them."""
PRODUCT = tuple(ROOT / name for name in ("pointit", *LINKS))
"""Folders of the product."""

ROOMS = tuple(
    room
    for room in (*sorted((ROOT / "pointit").iterdir()), *PRODUCT[1:])
    if room.is_dir() and not room.is_symlink() and room.name != "__pycache__"
)


def module_name(path: Path) -> str:
    """Return the name of the module of the product or the laboratory at `path`."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[1:] if parts[0] == "lab" else parts if parts[0] == "pointit" else ("pointit", *parts)
    return ".".join(parts).removesuffix(".__init__")


SHELLS = {"__init__.py", "config.py", "service.py"}
"""Files of a service that are no core."""
NO_CORE = "\nNo core: "
"""Beginning of the line in the docstring of other modules that wait for devices or time, or write files."""
LAB = ROOT / "lab/pointit_lab"
BENCHMARKS = LAB / "benchmarks"


@cache
def shipped() -> tuple[Path, ...]:
    """Every module that is installed, but for the benchmarks, which measure bare Zenoh beside ours."""
    every = (path for folder in (*PRODUCT, LAB) for path in sorted(folder.rglob("*.py")))
    return tuple(path for path in every if BENCHMARKS not in path.parents)


@cache
def all_modules() -> tuple[Path, ...]:
    others = [path for folder in (BENCHMARKS, ROOT / "tests") for path in sorted(folder.rglob("*.py"))]
    return (*shipped(), *others)


@cache
def text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(text(path), str(path))


def is_core(path: Path) -> bool:
    """Return True if a module of a service is pure: neither its shell, nor marked `No core: REASON`."""
    return path.name not in SHELLS and NO_CORE not in text(path)


def shown(path: Path, node: ast.expr | ast.stmt | None = None) -> str:
    """A place as an editor takes it, `pointit/cli/main.py:12`."""
    line = f":{node.lineno}" if node is not None else ""
    return f"{path.relative_to(ROOT)}{line}"


def importers(module: str, paths: tuple[Path, ...]) -> Iterator[str]:
    """Places that import `module` or something of it, in whatever form and at whatever depth."""
    forms = (module, f"from {module.rpartition('.')[0]} import")
    for path in paths:
        if any(form in text(path) for form in forms):  # parsing every module takes seconds
            found = (node for name, node in _imports(path) if f"{name}.".startswith(f"{module}."))
            yield from dict.fromkeys(shown(path, node) for node in found)


def imports_in(code: ast.AST) -> Iterator[tuple[str, ast.stmt | ast.expr]]:
    """Imports at any depth of `code`, in whatever form, and their places."""
    for node in ast.walk(code):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield from ((f"{node.module}.{alias.name}", node) for alias in node.names)
        elif isinstance(node, ast.Call) and _is_dynamic_import(node):
            yield from ((str(each.value), node) for each in node.args[:1] if isinstance(each, ast.Constant))


@cache
def _imports(path: Path) -> tuple[tuple[str, ast.stmt | ast.expr], ...]:
    return tuple(imports_in(tree(path)))


def literals(path: Path) -> Iterator[ast.Constant]:
    """String literals of a module, pieces of f-strings among them, docstrings not."""
    prose = {
        id(node.value)
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            yield node


def _is_dynamic_import(node: ast.Call) -> bool:
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    return name in ("import_module", "__import__")
