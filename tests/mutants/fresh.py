"""Fresh mutants: one-line mistakes in the cores that nobody chose, and the nets that must notice them.

The cores are `geometry`, and the modules of `services` that are no shells and not marked `No core:`. A
mistake replaces an operator, a number or a truth, takes one side of an expression, or leaves out a statement.
Sentences that people read are left as they are.
"""

import ast
import random
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

from tests.architecture.sources import is_core

ROOT = Path(__file__).parents[2]
NETS = ("tests/golden/test_golden.py", "tests/replay/test_replay.py")
"""Tests for mutants that the unit tests of their room let pass."""
GEOMETRY = "pointit/geometry"

OPPOSITES: tuple[tuple[type[ast.AST], type[ast.AST]], ...] = (
    (ast.Lt, ast.LtE),
    (ast.Gt, ast.GtE),
    (ast.Eq, ast.NotEq),
    (ast.Is, ast.IsNot),
    (ast.In, ast.NotIn),
    (ast.Add, ast.Sub),
    (ast.Mult, ast.Div),
    (ast.And, ast.Or),
    (ast.BitAnd, ast.BitOr),
)
OPERATORS: dict[type[ast.AST], Any] = {a: b for pair in OPPOSITES for a, b in (pair, pair[::-1])}
"""Operators that mistakes put in place of others."""


def core_files() -> list[str]:
    """Return the paths of all cores."""
    files = [path.relative_to(ROOT).as_posix() for path in sorted((ROOT / GEOMETRY).glob("[!_]*.py"))]
    for path in sorted((ROOT / "services").glob("*/**/*.py")):
        if is_core(path):
            files.append(path.relative_to(ROOT).as_posix())
    return files


def unit_tests(file: str) -> list[str]:
    """Return the test files of the room of `file`, those that name its module first, and the laboratory's."""
    room = Path(file.removeprefix("pointit/"))
    first, second, *_ = room.parts
    folder = ROOT / "tests/unit" / (second if first == "services" else first)
    module = ".".join(("pointit", *room.with_suffix("").parts))
    tests = sorted(folder.rglob("test_*.py"), key=lambda path: module not in path.read_text("utf-8"))
    for path in sorted((ROOT / "tests/lab").rglob("test_*.py")):
        if module in path.read_text("utf-8"):
            tests.append(path)
    return [path.relative_to(ROOT).as_posix() for path in tests]


def of_file(file: str, seed: str) -> list[tuple[str, str]]:
    """Return lines of a file, each with one mistake, in an order by `seed`."""
    drawn: list[tuple[float, str, str]] = []
    for line, mistakes in _mistakes_by_line(file).items():
        chance = random.Random(f"{seed} {file} {line}")
        drawn.append((chance.random(), line, chance.choice(mistakes)))
    return [(line, mutated) for _, line, mutated in sorted(drawn)]


def _mistakes_by_line(file: str) -> dict[str, list[str]]:
    """Return the mutated forms of each line of a file that can be mutated, in its order."""
    by_line = defaultdict[str, list[str]](list)
    for line, mutated in changes((ROOT / file).read_text("utf-8")):
        by_line[line].append(mutated)
    return dict(by_line)


def sample(count: int, seed: str, without: set[tuple[str, str]]) -> list[tuple[str, str, str]]:
    """Return files, lines and mistakes: one for each of `count` lines, none of them in `without`.

    The draw of a line depends on the seed and this line alone: it stays where others change.
    """
    drawn: list[tuple[float, str, str, str]] = []
    for file in core_files():
        for line, mistakes in _mistakes_by_line(file).items():
            if (file, line) in without:
                continue
            chance = random.Random(f"{seed} {file} {line}")
            drawn.append((chance.random(), file, line, chance.choice(mistakes)))
    first = sorted(drawn)[:count]
    return [(file, line, mutated) for _, file, line, mutated in first]


def changes(source: str) -> Iterator[tuple[str, str]]:
    """Yield lines of `source` that occur once, and what a mistake makes of them, without indentation."""
    lines = source.splitlines()
    stripped = [line.strip() for line in lines]
    for node in _code(ast.parse(source)):
        if not isinstance(node, ast.expr | ast.stmt):
            continue
        if node.end_lineno != node.lineno:
            continue
        text = lines[node.lineno - 1]
        line = stripped[node.lineno - 1]
        # columns are of bytes, and a row must name one line
        if not line.isascii() or stripped.count(line) != 1:
            continue
        before = text[: node.col_offset]
        after = text[node.end_col_offset :]
        for instead in _mistakes(node):
            mutated = f"{before}{instead}{after}".strip()
            if mutated != line:
                yield line, mutated


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what is computed: no texts, no types, no errors."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        children = value if isinstance(value, list) else [value]
        for child in cast("list[object]", children):
            if isinstance(child, ast.JoinedStr | ast.Raise | ast.Assert):
                continue
            if isinstance(child, ast.AST):
                yield from _code(child)


def _mistakes(node: ast.AST) -> Iterator[str]:
    """Yield what a mistake puts in place of `node`."""
    match node:
        case ast.Compare() | ast.BinOp() | ast.BoolOp():
            yield from map(_text, _miscalculated(node))
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield _text(operand)
        case ast.IfExp(body=body, orelse=orelse):
            yield from (_text(body), _text(orelse))
        case ast.Constant(value=bool(value)):
            yield str(not value)
        case ast.Constant(value=int(value) | float(value)):
            yield repr(value + 1)
        case ast.AugAssign():
            yield "pass"
        case ast.Expr(value=ast.Call(func=called)) if not ast.unparse(called).startswith("log."):
            yield "pass"
        case _:
            pass


def _miscalculated(node: ast.Compare | ast.BinOp | ast.BoolOp) -> Iterator[ast.expr]:
    """Yield `node` with another operator, and its sides alone."""
    match node:
        case ast.Compare(left=left, ops=[op], comparators=rest):
            operator = OPERATORS[type(op)]()
            yield ast.Compare(left, [operator], rest)
        case ast.BinOp(left=left, op=op, right=right):
            if type(op) in OPERATORS:
                yield ast.BinOp(left, OPERATORS[type(op)](), right)
            yield left
        case ast.BoolOp(op=op, values=values):
            yield ast.BoolOp(OPERATORS[type(op)](), values)
            yield from (values[0], values[-1])
        case _:
            pass


def _text(node: ast.expr) -> str:
    return f"({ast.unparse(node)})"
