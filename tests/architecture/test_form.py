"""`scripts/house`, `expression-load`, `names` and `prose` on small examples; limits of the product."""

import importlib.util
import subprocess
import sys
import tomllib
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.architecture.sources import ROOT
from tests.support import there
from tests.support.invoked import python

CONSTANTS = """
from os import path
HEAD = 1
def double(x): return 2 * x
MISPLACED = [path, HEAD, *(each for each in "ab")]
DOUBLED = double(2)
LATER = DOUBLED + 1
"""
STATEMENTS = """
def choose(a, b):
    c = a if a and b else [x for x in b if x]
    d, e = a, b
    def inner():
        return b and a
    for each in a or b:
        # a step
        print(each)
"""
AKIN = (("people", "person"), ("ctx", "context"), ("localizer", "localization"), ("user", "person"))
STRANGE = (("seat", "context"), ("led", "ledger"), ("contract", "controller"), ("in", "input"))
PACKAGE = {
    "a/context.py": "class EndpointContext: ...\nclass Shared(EndpointContext): ...\n"
    "def run(seat: EndpointContext, contexts: list[Shared], count: int, previous: Shared): ...\n",
    "a/desk.py": "class Person: ...\n",
    "b/person.py": "class Person: ...\n",
}


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_loader(name, SourceFileLoader(name, str(ROOT / "scripts" / name)))
    module = importlib.util.module_from_spec(there(spec))
    sys.modules[name] = module  # dataclasses look it up
    there(there(spec).loader).exec_module(module)
    return module


def measured(text: str, folder: Path) -> Any:
    path = folder / "example.py"
    path.write_text(text, encoding="utf-8")
    return script("expression-load").measure([path])


@pytest.mark.parametrize("name", ["house", "expression-load"])
def test_no_limit_is_exceeded(name: str) -> None:
    done = python(ROOT / "scripts" / name, "--limits", cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr


def test_import_circle_is_found() -> None:
    house = script("house")
    assert house.circle({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert set(house.circle({"a": {"b"}, "b": {"c"}, "c": {"b"}})) == {"b", "c"}


def test_modules_on_neither_side_of_the_core_are_found() -> None:
    modules = ["pointit.api", "pointit.api.site", "pointit.cli", "pointit.cli.run", "pointit.new"]
    unlisted = script("house").unlisted_modules(modules, ["pointit.api"], ["pointit.cli.run", "pointit.cli"])
    assert unlisted == ["pointit.new"]


def test_constants_below_definitions_are_told_apart(tmp_path: Path) -> None:
    load = measured(CONSTANTS, tmp_path)
    assert [place.rpartition(" ")[2] for place in load.misplaced] == ["MISPLACED"]
    assert [place.rpartition(" ")[2] for place in load.constants_below] == ["DOUBLED", "LATER"]


def test_branches_nodes_and_comments_are_counted(tmp_path: Path) -> None:
    load = measured(STATEMENTS, tmp_path)
    branches = sorted(branches for branches, _, _ in load.statements)
    assert branches == [0, 0, 1, 1, 1, 4], "the inner function counts also in the outer one"
    assert (load.comments, len(load.tuple_assignments)) == (1, 1)


def test_limits_of_branches_only_fall(tmp_path: Path) -> None:
    form = script("expression-load")
    load = measured(STATEMENTS, tmp_path)
    loads = {"api": load, "total": load}
    limits = {"constants_below": 0, "tuple_assignments": 0, "two_branches_percent": {"api": 16.0}}
    assert [sentence.partition(":")[0] for sentence in form.faults(loads, limits)] == [
        "api",
        "tuple_assignments",
    ]
    assert tomllib.loads(form.limits_text(loads, limits)) == limits
    looser = {"constants_below": 1, "tuple_assignments": 2, "two_branches_percent": {"api": 20.0}}
    lowered = tomllib.loads(form.limits_text(loads, looser))
    assert lowered == {"constants_below": 0, "tuple_assignments": 1, "two_branches_percent": {"api": 16.7}}
    assert form.faults(loads, lowered) == []


def test_plurals_abbreviations_and_synonyms_are_akin_and_other_words_not() -> None:
    names = script("names")
    assert names.words("_LEDOutput_v2") == ("led", "output", "v2")
    assert [pair for pair in AKIN + STRANGE if names.is_akin(*pair)] == list(AKIN)


def test_names_that_share_no_word_with_their_class_are_reported(tmp_path: Path) -> None:
    for path, text in PACKAGE.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    hits = script("names").report([tmp_path])
    assert [(hit.check, hit.name) for hit in hits] == [
        ("bindings", "seat"),
        ("files", "desk"),
        ("twice", "Person"),
    ]


@pytest.mark.parametrize(
    ("name", "text", "rule"),
    [
        ("docstring.py", '"""Take the map."""', "use an active verb with an effect, or a noun"),
        ("docstring.py", '"""Whether it flies."""', "use an active verb with an effect, or a noun"),
        ("message.py", 'raise ValueError("keys for who' + ' asks")', "name the role"),
        ("help.py", 'option(help=f"at most so' + ' many of {kind}")', "name the number"),
        ("comment.py", "x = 1  # kept ti" + "ll it ends", "write until"),
        ("parameter.py", "def wait(ti" + "ll) -> None: ...", "write until"),
        ("comment.ts", "const x = 1; // kept ti" + "ll it ends", "write until"),
        ("page.md", "A map that hee" + "ds nothing.", "use an everyday word"),
        ("code.ts", "const till = so_long;", ""),
        ("text.py", 'text = "The map of those who point, so long as they point, and who is here."', ""),
        ("picture.py", '"""Take the picture of the page."""', ""),
    ],
)
def test_prose_reads_texts_and_identifiers(tmp_path: Path, name: str, text: str, rule: str) -> None:
    file = tmp_path / name
    file.write_text(text + "\n", encoding="utf-8")
    done = subprocess.run([ROOT / "scripts/prose", file], capture_output=True, text=True, check=False)
    assert done.returncode == int(bool(rule)), done.stderr
    assert done.stdout.startswith(f"{file}:1: {rule}: " if rule else "")


def test_prose_prints_the_whole_sentence(tmp_path: Path) -> None:
    file = tmp_path / "docstring.py"
    words = "The map of the room in which every lamp stands", "and every strip is kept ti" + "ll it ends."
    file.write_text(f'"""First sentence.\n\nAnother one. {words[0]}\n{words[1]} Last one.\n"""\n')
    done = subprocess.run([ROOT / "scripts/prose", file], capture_output=True, text=True, check=False)
    assert done.stdout == f"{file}:1: write until: {' '.join(words)}\n", done.stderr
