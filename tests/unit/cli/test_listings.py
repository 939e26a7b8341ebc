"""Listings of plug-ins and services: complete, and without running code of other packages."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from pointit.cli.inspect.declaration import read_service, read_summary
from pointit.cli.inspect.listings import plugins, services
from pointit.cli.main import front
from pointit.plugins import GROUPS
from pointit.schemas import topics
from pointit.services import registry
from tests.support import strangers

COMMAND = "my-tally"
PLAIN = """
from __future__ import annotations
from typing import ClassVar

import pointit.plugins as kit
from pointit.plugins import Config, Delivery, ImuSource, LedOutput, Message, RecogniserPlugin
from pointit.plugins import Request, SelectionMethod, Service, ServicePlugin, Topic, topics

PLACE = "on the " + "wrist"

class Count(Message):
    selected: int = 0

TALLY: Topic[Count] = Topic(
    key="tally/count", message=Count, delivery=Delivery.STATE, rate_hz=None, writers=("tally",), about=""
)

class Base(Service[Config]):
    SCOPE: ClassVar = "site"

class Tally(Base):
    NAME: ClassVar[str] = "tally"
    CONFIG = Config

WAVING = ImuSource(
    summary=f"an arm that waves, {PLACE}", config=Config, argument="rate_hz", example="50",
    argument_optional=True, make=lambda config, surroundings: None,
)
LAMP = kit.LedOutput(summary="one lamp", config=Config, argument="host", make=print)
WAY = SelectionMethod(summary="at once", config=Config, make=print)
EARS = RecogniserPlugin(summary="words of a radio", config=Config, make=print)
TALLY_SERVICE = ServicePlugin(
    summary="counts selections",
    config=Config,
    make=Tally,
    reads=(topics.SELECTION_EVENTS,),
    writes=(TALLY,),
    serves=[],
)
raise RuntimeError("this module was imported")
"""

ENTRIES = {
    "imu_sources": "plain-wave = strangers_plain:WAVING",
    "led_outputs": "plain-lamp = strangers_plain:LAMP",
    "selection_methods": "plain-way = strangers_plain:WAY",
    "recognisers": "plain-ears = strangers_plain:EARS",
    "services": "tally = strangers_plain:TALLY_SERVICE",
    "commands": f"{COMMAND} = strangers_plain:report\nrun = strangers_plain:run",
}

UNUSUAL = """
from pointit.plugins import Config, ImuSource

def source(text):
    return ImuSource(summary=text, config=Config, make=print)

MADE = source("made by a function")
NEEDY = ImuSource(summary="needs what is absent", config=Config, make=print)
"""


@pytest.fixture
def plain(tmp_path: Path) -> Iterator[None]:
    with strangers.installed(tmp_path, "strangers_plain", PLAIN, **ENTRIES):
        yield
    assert "strangers_plain" not in sys.modules


@pytest.mark.usefixtures("plain")
def test_plug_ins_of_each_kind_are_listed_without_importing_their_modules() -> None:
    group = front()
    with click.Context(group):
        rows = {row["use"]: row for row in plugins().rows if row["package"] == "strangers-parts"}
    assert {use: row["about"] for use, row in rows.items() if row["name"] != "run"} == {
        "--imu plain-wave[:50]": "an arm that waves, on the wrist",
        "--output plain-lamp:HOST": "one lamp",
        "--method plain-way": "at once",
        "listen --recogniser plain-ears": "words of a radio",
        "--with tally": "counts selections",
        f"pointit {COMMAND}": "",
    }
    assert (
        "strangers-parts adds no command 'run', which is a name of PointIt's own"
        in rows["pointit run"]["about"]
    )
    assert {"--set robot.driver=vda5050", "--imu serial:/dev/ttyUSB0"} & {
        row["use"] for row in plugins().rows
    }


@pytest.mark.usefixtures("plain")
def test_service_is_listed_with_its_scope_and_keys_without_importing_its_module() -> None:
    (row,) = (row for row in services().rows if row["name"] == "tally")
    assert row == {
        "name": "tally",
        "scope": "site",
        "extra": "",
        "reads": [topics.SELECTION_EVENTS.key],
        "writes": ["tally/count"],
        "serves": [],
        "about": "counts selections",
    }
    assert [row["name"] for row in services().rows if row["name"] == "web"] == ["web"]
    assert "tally" not in [row.name for row in registry.PROCESSES]


@pytest.mark.parametrize("kind", GROUPS)
def test_source_of_each_own_plug_in_states_what_it_is_when_imported(kind: str) -> None:
    group = GROUPS[kind]
    for name in group.names:
        stated, imported = read_summary(group, name), group.get(name)
        assert (stated.summary, stated.value) == (imported.summary, imported.value)


def test_plug_in_that_a_function_makes_is_imported_for_the_listing(tmp_path: Path) -> None:
    with strangers.installed(
        tmp_path, "strangers_unusual", UNUSUAL, imu_sources="made = strangers_unusual:MADE"
    ):
        rows = {row["name"]: row["about"] for row in plugins().rows}
    assert rows["made"] == "made by a function"


@pytest.mark.parametrize(
    ("module", "source", "reason"),
    [
        ("strangers_needy", f"import absent_library\n{UNUSUAL}", "ModuleNotFoundError: .*absent_library"),
        ("strangers_typo", f"{UNUSUAL}\ndef (", "SyntaxError"),
        ("strangers_other", "from pointit.plugins import Config", "no attribute 'NEEDY'"),
        ("strangers_gone", "from pointit.plugins import Gone\nNEEDY = Gone(summary='')", "ImportError"),
    ],
)
def test_plug_in_that_cannot_be_imported_is_listed_with_its_fault(
    module: str, source: str, reason: str, tmp_path: Path
) -> None:
    with strangers.installed(tmp_path, module, source, imu_sources=f"needy = {module}:NEEDY"):
        about = {row["name"]: row["about"] for row in plugins().rows}["needy"]
    assert "IMU source 'needy' of strangers-parts cannot be imported" in about
    assert re.search(reason, about)


def test_names_are_followed_through_modules_of_the_same_package(tmp_path: Path) -> None:
    package = tmp_path / "strangers_many"
    package.mkdir()
    (package / "__init__.py").write_text("raise RuntimeError")
    (package / "keys.py").write_text(
        "from pointit.schemas.topics import Topic, CURSOR\n"
        "MINE = Topic(key='many/level')\nALL = (CURSOR, MINE)\n"
    )
    (package / "parts.py").write_text(
        "from pointit.plugins import Service, ServicePlugin\n"
        "from . import keys\nfrom .keys import MINE\nimport strangers_many.keys as again\n"
        "class Many(Service):\n    SCOPE = 'user'\n"
        "MANY = ServicePlugin(summary='many', make=Many, reads=keys.ALL, writes=(MINE, again.MINE))\n"
    )
    with strangers.installed(tmp_path, "no_module", "", services="many = strangers_many.parts:MANY"):
        assert read_service("many") == {
            "scope": "user",
            "extra": "",
            "reads": [topics.CURSOR.key, "many/level"],
            "writes": ["many/level", "many/level"],
            "serves": [],
            "about": "many",
        }


def test_source_that_refers_to_itself_ends(tmp_path: Path) -> None:
    source = "from pointit.plugins import ImuSource\nA = B\nB = A\nNEEDY = ImuSource(summary=A)\n"
    with strangers.installed(tmp_path, "strangers_loop", source, imu_sources="needy = strangers_loop:NEEDY"):
        about = {row["name"]: row["about"] for row in plugins().rows}["needy"]
    assert "NameError" in about
