"""`scripts/names`: its checks on small packages. `scripts/check` runs it on the product."""

import importlib.util
import sys
import textwrap
from collections.abc import Callable
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

import pytest

from tests.architecture.sources import ROOT
from tests.support import there

SCRIPT = ROOT / "scripts/names"
Write = Callable[[str, str], None]


@pytest.fixture(scope="module")
def names() -> ModuleType:
    spec = importlib.util.spec_from_loader("names", SourceFileLoader("names", str(SCRIPT)))
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["names"] = module
    there(spec.loader).exec_module(module)
    return module


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def to(path: str, text: str) -> None:
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(textwrap.dedent(text), encoding="utf-8")

    return to


@pytest.fixture
def hits(names: ModuleType, tmp_path: Path) -> Callable[[str], list[str]]:
    def of(check: str) -> list[str]:
        found, _ = names.report([tmp_path], tmp_path)
        return sorted(hit.name for hit in found if hit.check == check)

    return of


def test_identifiers_are_split_at_case_and_underscore(names: ModuleType) -> None:
    assert names.words("LEDOutput_v2") == ("led", "output", "v2")
    assert names.words("_SiteDoor") == ("site", "door")
    assert names.words("HTTPServer") == ("http", "server")


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("people", "person"),
        ("studies", "study"),
        ("ctx", "context"),
        ("config", "configuration"),
        ("localizer", "localization"),
        ("boxes", "box"),
        ("user", "person"),
        ("recognition", "recogniser"),
    ],
)
def test_plurals_short_forms_and_synonyms_are_akin(names: ModuleType, one: str, other: str) -> None:
    assert names.is_akin(one, other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("seat", "context"),
        ("led", "ledger"),
        ("trust", "settings"),
        ("contract", "controller"),
        ("news", "localization"),
        ("in", "input"),
        ("desk", "server"),
    ],
)
def test_words_of_different_things_are_not_akin(names: ModuleType, one: str, other: str) -> None:
    assert not names.is_akin(one, other)


def test_parameters_attributes_variables_and_with_are_bindings(
    write: Write, hits: Callable[[str], list[str]]
) -> None:
    write(
        "a/context.py",
        """
        class EndpointContext: ...
        class Other:
            seat: EndpointContext
            def __init__(self, desk: "EndpointContext | None") -> None:
                self._pew: list[EndpointContext] = []
                self._bench = EndpointContext()
                chair = EndpointContext()
                with EndpointContext() as stool: ...
        def run(endpoint: EndpointContext, contexts: dict[str, EndpointContext]) -> None: ...
        """,
    )
    assert hits("bindings") == ["_bench", "_pew", "chair", "desk", "seat", "stool"]


def test_types_without_a_word_of_their_own_are_skipped(
    write: Write, hits: Callable[[str], list[str]]
) -> None:
    write(
        "a/b.py",
        """
        import asyncio
        import numpy as np
        from collections.abc import Callable
        from typing import Annotated, Any, TypeVar
        T = TypeVar("T")
        Handler = Callable[[int], None]
        Metre = Annotated[float, "m"]
        class Person: ...
        class Closable: ...
        def run(x: int, y: T, z: Any, tell: Handler, far: Metre, a: np.ndarray, done: asyncio.Event,
                kind: type[Person], pairs: list[tuple[str, Person]], token: Closable,
                by_room: dict[str, list[Person]]): ...
        """,
    )
    assert hits("bindings") == []


def test_bases_aliases_roles_initials_and_enumerations_count(
    write: Write, hits: Callable[[str], list[str]]
) -> None:
    write(
        "a/b.py",
        """
        from enum import Enum
        class Output: ...
        class Artnet(Output): ...
        class Delivery(Enum): ...
        class Query: ...
        class Belt: ...
        class Strip: ...
        Lane = Belt | Strip
        def run(output: Artnet, mode: Delivery, q: Query, lane: Lane, belt: Lane, previous: Belt,
                pending: list[Strip], fob: Lane): ...
        """,
    )
    assert hits("bindings") == ["fob"]


def test_an_alias_counts_in_files_that_import_it(names: ModuleType, write: Write, tmp_path: Path) -> None:
    write("a/tap.py", "class Tap: ...\n")
    write(
        "b/bus.py", "from typing import Callable\nTap = Callable[[int], None]\ndef tap(handler: Tap): ...\n"
    )
    write("c/use.py", "from a.tap import Tap\ndef use(handler: Tap): ...\n")
    found, _ = names.report([tmp_path], tmp_path)
    assert [hit.file for hit in found if hit.check == "bindings"] == ["c/use.py"]


def test_third_party_classes_count_with_the_words_of_their_module(
    write: Write, hits: Callable[[str], list[str]]
) -> None:
    write(
        "a/b.py",
        """
        import zenoh
        from rich.console import Console
        def run(session: zenoh.Session, link: zenoh.Sample, screen: Console): ...
        """,
    )
    assert hits("bindings") == ["link", "screen"]


def test_a_file_is_named_after_a_class_a_base_a_constant_or_its_docstring(
    write: Write, hits: Callable[[str], list[str]]
) -> None:
    write("a/person.py", "class Person: ...\n")
    write("a/service.py", "class Service: ...\n")
    write("b/service.py", "class Robot(Service): ...\n")
    write("b/cramer_rao.py", '"""Cramer-Rao bounds of poses."""\ndef median_m(): ...\n')
    write("b/limits.py", "LIMIT = 3\ndef check(): ...\n")
    write("b/export.py", "def command(): ...\n")
    write("b/place.py", '"""The rows."""\nclass Column: ...\n')
    write("b/desk.py", '"""The desk."""\nclass Person: ...\n')
    assert hits("files") == ["desk", "place"]


def test_a_public_class_that_is_defined_twice_counts_once(
    write: Write, hits: Callable[[str], list[str]]
) -> None:
    write("a/x.py", "class Plan: ...\nclass _Entry: ...\n")
    write("b/y.py", "class Plan: ...\nclass _Entry: ...\nclass Outer:\n    class Inner: ...\n")
    assert hits("twice") == ["Plan"]


def test_house_words_are_found_in_names_and_texts_but_terms_are_not(
    write: Write, hits: Callable[[str], list[str]]
) -> None:
    write(
        "a/x.py",
        '''
        """What strangers write."""
        LEAST_SQUARES = 1
        LEAST_DEG = 2
        def _meet(desks: int) -> None: ...
        keep = 1
        ''',
    )
    assert hits("house") == ["LEAST_DEG", "_meet", "desks", "“stranger”"]


def test_questions_are_found_in_docstrings_help_and_parameters(
    write: Write, hits: Callable[[str], list[str]]
) -> None:
    write(
        "a/x.py",
        '''
        import click
        def log(key: str, what: str) -> None:
            """Write a line."""
        def whose() -> str:
            """Say who has it."""
        option = click.option("--user", help="whose service it is")
        limit = 3
        """How many."""
        def _private():
            """What is private."""
        ''',
    )
    assert hits("questions") == ["How", "Say", "what", "whose", "whose"]


def test_tests_of_a_package_are_left_out_and_broken_files_are_named(
    write: Write, hits: Callable[[str], list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    write("a/tests/test_x.py", "class Desk: ...\ndef run(seat: Desk): ...\n")
    write("a/bad.py", "def (:\n")
    assert hits("bindings") == []
    assert "bad.py: cannot be read" in capsys.readouterr().err


@pytest.fixture
def rooms(write: Write) -> None:
    write("runtime/bus/x.py", "class Server: ...\ndef run(table: Server, fob: Server): ...\n")
    write("maps/y.py", "class Server: ...\ndef run(fob: Server): ...\n")


@pytest.mark.usefixtures("rooms")
def test_the_table_has_a_row_for_each_room_and_the_sum(
    names: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert names.main([str(tmp_path)]) == 0
    rows = [line.split()[:4] for line in capsys.readouterr().out.splitlines()[1:]]
    assert rows == [["maps", "1", "of", "1"], ["runtime/bus", "1", "of", "2"], ["all", "2", "of", "3"]]


@pytest.mark.usefixtures("rooms")
def test_a_room_can_be_chosen_and_an_unknown_one_is_named(
    names: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert names.main([str(tmp_path), "--room", "runtime", "--check", "bindings", "--list"]) == 0
    assert capsys.readouterr().out.count("fob") == 1
    with pytest.raises(SystemExit):
        names.main([str(tmp_path), "--room", "cellar"])
    assert "no room 'cellar'" in capsys.readouterr().err


@pytest.mark.usefixtures("rooms")
def test_a_limit_fails_when_it_is_exceeded_or_can_be_lowered(
    names: ModuleType, write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    limits = tmp_path / "limits.toml"
    product = str(tmp_path)
    rows = '"maps" = { bindings = 3, files = 1, twice = 1 }\n"runtime/bus" = { files = 1 }\n'
    limits.write_text(f"exceptions = []\n\n[limits]\n{rows}", encoding="utf-8")
    assert names.main([product, "--limits"], limits) == 1
    assert "runtime/bus: bindings: 1, limit 0" in capsys.readouterr().out
    write("runtime/bus/x.py", "class Server: ...\ndef run(table: Server, server: Server): ...\n")
    assert names.main([product, "--limits"], limits) == 1
    assert "maps: bindings: 1, limit 3. Lower it" in capsys.readouterr().out
    assert names.main([product, "--lower"], limits) == 0
    assert limits.read_text(encoding="utf-8").endswith(
        '"maps" = { bindings = 1, files = 1, twice = 1 }\n"runtime/bus" = { files = 1 }\n'
    )
    write("maps/other.py", "from maps.y import Server\ndef other(fib: Server): ...\n")
    assert names.main([product, "--lower"], limits) == 1, "a limit never rises"
    excepted = 'exceptions = ["bindings fib a term of the paper"]'
    limits.write_text(
        limits.read_text(encoding="utf-8").replace("exceptions = []", excepted), encoding="utf-8"
    )
    assert names.main([product, "--limits"], limits) == 0


@pytest.mark.parametrize(
    ("exceptions", "message"),
    [
        (["bindings fib"], "write CHECK NAME REASON"),
        (["names fib a term"], "write CHECK NAME REASON"),
        ([f"bindings name{number} a term" for number in range(41)], "41 exceptions, limit 40"),
    ],
)
def test_exceptions_have_a_reason_and_are_few(names: ModuleType, exceptions: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        names.read_exceptions({"exceptions": exceptions})
