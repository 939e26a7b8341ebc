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


AKIN = (
    ("people", "person"), ("studies", "study"), ("ctx", "context"), ("localizer", "localization"),
    ("boxes", "box"), ("user", "person"),
)  # fmt: skip
STRANGE = (("seat", "context"), ("led", "ledger"), ("contract", "controller"), ("in", "input"))


def test_plurals_short_forms_and_synonyms_are_akin_and_other_words_are_not(names: ModuleType) -> None:
    assert names.words("_LEDOutput_v2") == ("led", "output", "v2")
    assert [pair for pair in AKIN + STRANGE if names.is_akin(*pair)] == list(AKIN)


PACKAGES = {
    "bindings": {
        "a/context.py": """
        import asyncio
        import zenoh
        from collections.abc import Callable
        class Query: ...
        class EndpointContext:
            seat: "EndpointContext | None"
        class SharedContext(EndpointContext): ...
        Handler = Callable[[int], None]
        Lane = Query | EndpointContext
        def run(endpoint: EndpointContext, contexts: dict[str, SharedContext], pew: list[SharedContext],
                q: Query, previous: Query, fob: Lane, lane: Lane, tell: Handler, far: float,
                done: asyncio.Event, session: zenoh.Session, link: zenoh.Sample) -> None:
            with EndpointContext() as stool: ...
        """,
        "a/tests/test_x.py": "class Desk: ...\ndef run(seat: Desk): ...\n",
    },
    "files": {
        "a/service.py": "class Service: ...\n",
        "b/service.py": "class Robot(Service): ...\n",
        "b/cramer_rao.py": '"""Cramer-Rao bounds of poses."""\ndef median_m(): ...\n',
        "b/limits.py": "LIMIT = 3\ndef check(): ...\n",
        "b/desk.py": '"""The desk."""\nclass Person: ...\n',
    },
    "twice": {
        "a/x.py": "class Plan: ...\nclass _Entry: ...\n",
        "b/y.py": "class Plan: ...\nclass _Entry: ...\nclass Outer:\n    class Inner: ...\n",
    },
    "house": {
        "a/x.py": '"""What strangers write."""\nLEAST_SQUARES = LEAST_DEG = 1\ndef _meet(desks: int): ...\n'
    },
    "questions": {
        "a/x.py": '''
        def log(key: str, what: str) -> None:
            """Write a line."""
        def whose() -> str:
            """Say who has it."""
        option = click.option("--user", help="whose service it is")
        limit = 3
        """How many."""
        def _private():
            """What is private."""
        '''
    },
}
"""Small packages with offences, by the check that finds them."""


@pytest.mark.parametrize(
    ("check", "offences"),
    [
        ("bindings", ["fob", "link", "pew", "seat", "stool"]),
        ("files", ["desk"]),
        ("twice", ["Plan"]),
        ("house", ["LEAST_DEG", "_meet", "desks", "“stranger”"]),
        ("questions", ["How", "Say", "what", "whose", "whose"]),
    ],
)
def test_each_check_finds_its_offences(
    names: ModuleType, write: Write, tmp_path: Path, check: str, offences: list[str]
) -> None:
    for path, text in PACKAGES[check].items():
        write(path, text)
    found, _ = names.report([tmp_path], tmp_path)
    assert sorted(hit.name for hit in found if hit.check == check) == offences


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
