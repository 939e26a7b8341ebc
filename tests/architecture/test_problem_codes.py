"""Codes of problems: every one is constant, in the reference's table, reported by a service and read."""

import ast
import re

from docs.website import reference
from pointit.schemas import problems
from pointit.schemas.problems import CODES, NO_DATA
from tests.architecture.sources import ROOT, module_name, shipped, text, tree

SENTENCE_READERS = (
    "pointit.diagnosis",
    "pointit.bridges.web",
    "pointit.bridges.ros2",
    "pointit.cli",
    "pointit.launch.run",
)


def test_every_problem_code_is_a_short_constant_in_the_reference() -> None:
    page = "\n".join(reference.problems())
    codes = reference.codes_in_use()
    assert len(codes) > 80, "the calls are found"
    for code in {*codes, *CODES}:
        assert re.fullmatch("[a-z]+(-[a-z]+)*", code), code
        assert len(code) <= problems.MAX_CODE
        assert f"| `{code}` |" in page


def test_every_code_of_all_services_is_reported_and_read() -> None:
    reported = reference.codes_in_use()
    names = {
        value: name for name, value in vars(problems).items() if isinstance(value, str) and name.isupper()
    }
    users = [path for path in shipped() if module_name(path) != "pointit.schemas.problems"]
    for code in CODES:
        is_named = code in names and any(re.search(rf"\b{names[code]}\b", text(path)) for path in users)
        assert code in reported or is_named, f"nobody reports {code}"
        assert is_named or code in {*NO_DATA, "connection", "silence"}, f"nobody reads {code}"


def test_no_reader_takes_a_sentence_apart() -> None:
    """A regular expression, or a search for words, in the sentence of a problem."""
    parts = re.compile(r"(sentence|warning|warnings|finding\.remedy)\b")
    found = []
    for path in shipped():
        if not module_name(path).startswith(SENTENCE_READERS):
            continue
        for node in ast.walk(tree(path)):
            searched: list[ast.expr] = []
            if not isinstance(node, ast.expr):
                continue
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                is_search = node.func.attr in (
                    "search",
                    "match",
                    "fullmatch",
                    "sub",
                    "split",
                    "findall",
                    "partition",
                )
                searched = node.args if is_search else []
            elif isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In):
                searched = node.comparators if isinstance(node.left, ast.Constant) else []
            found += [
                f"{path.relative_to(ROOT)}:{node.lineno}"
                for each in searched
                if isinstance(each, ast.Attribute | ast.Name) and parts.search(ast.unparse(each))
            ]

    assert found == []
