"""Plug-ins of packages: found by name, and reported in one sentence when they cannot be used."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import click
import pytest

from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import Plugin, PluginConfig, PluginGroup
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.process import service_command
from tests.support import strangers

MODULE = """
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import Plugin

class Mine(Config):
    address: str = ""
    speed: int = 3

MINE = Plugin(summary="my own", config=Mine, argument="address", example="HOST")
NUMBER = 7
"""

ENTRIES = """
mine = strangers_mine:MINE
number = strangers_mine:NUMBER
raising = strangers_raising:MINE
exiting = strangers_exiting:MINE
lacking = strangers_lacking:MINE [ble]
"""


@pytest.fixture
def parts(tmp_path: Path) -> Iterator[PluginGroup[Plugin]]:
    """Yield the plug-ins of a package that is installed for this test."""
    (tmp_path / "strangers_raising.py").write_text("open(f'{__file__}.imported', 'w').close()\n1 / 0\n")
    (tmp_path / "strangers_exiting.py").write_text("import sys\nsys.exit('no such device')\n")
    (tmp_path / "strangers_lacking.py").write_text("import a_library_that_is_absent\n")
    with strangers.installed(tmp_path, "strangers_mine", MODULE, test_parts=ENTRIES):
        yield PluginGroup("pointit.test_parts", Plugin, "part")


def test_plugin_of_another_package_is_chosen_and_validated(parts: PluginGroup[Plugin]) -> None:
    assert parts.names == ("exiting", "lacking", "mine", "number", "raising")
    assert parts.package("mine") == "strangers-parts"
    name, chosen = parts.choose("mine:[::1]:80")
    assert chosen == {"address": "[::1]:80"}
    config = parts.validate(name, chosen | {"speed": 5})
    assert config.model_dump() == {"address": "[::1]:80", "speed": 5}
    with pytest.raises(ValueError, match="no parameter sped; did you mean speed"):
        parts.validate(name, {"sped": 5})


def test_plugin_with_an_optional_argument_may_stand_alone() -> None:
    optional = Plugin(summary="", config=Config, argument="port", argument_optional=True)

    class Group(PluginGroup[Plugin]):
        def get(self, name: str) -> Plugin:
            del name
            return optional

    group = Group("pointit.test_parts", Plugin, "part")
    assert optional.value == "[:PORT]"
    assert group.choose("mine") == ("mine", {})
    assert group.choose("mine:COM3") == ("mine", {"port": "COM3"})
    with pytest.raises(ConfigError, match=r"write mine\[:PORT\]"):
        group.choose("mine:")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("absent", "no part 'absent' is installed; there are exiting, lacking, mine, number, raising"),
        ("number", "part 'number': strangers_mine:NUMBER is no Plugin"),
        ("raising", r"'raising' of strangers-parts cannot be imported \(ZeroDivisionError: .*\); update"),
        ("exiting", r"'exiting' of strangers-parts cannot be imported \(SystemExit: no such .*\); update"),
        ("lacking", r"of strangers-parts cannot be imported \(.*\); install strangers-parts\[ble\]"),
        ("mine", "write mine:HOST"),
        ("mine:", "write mine:HOST"),
    ],
)
def test_unusable_plugin_is_refused_in_one_sentence(
    parts: PluginGroup[Plugin], text: str, sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        parts.choose(text)


def install(name: str, entry: str, folder: Path) -> None:
    info = folder / f"{name}-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text(f"[pointit.test_parts]\n{entry}\n")


def test_name_that_two_packages_use_is_refused_alone(parts: PluginGroup[Plugin], tmp_path: Path) -> None:
    install("others", "number = others:NUMBER", tmp_path)
    with pytest.raises(ConfigError, match="is in two packages: uninstall others or strangers-parts"):
        parts.get("number")
    assert parts.names == ("exiting", "lacking", "mine", "number", "raising")
    assert parts.get("mine").summary == "my own"
    assert [*parts.configs()] == ["mine"]


def test_name_of_ours_stays_ours(parts: PluginGroup[Plugin], tmp_path: Path) -> None:
    install("pointit", "raising = strangers_mine:MINE", tmp_path)
    assert parts.package("raising") == "pointit"
    assert parts.get("raising").summary == "my own"


def test_group_without_any_plugin_says_what_to_install() -> None:
    with pytest.raises(ConfigError, match=r"no part is installed.*scripts/setup"):
        PluginGroup("pointit.no_such_parts", Plugin, "part").get("mine")


class ServiceConfig(PluginConfig):
    number: int = 3

    @classmethod
    def plugins(cls) -> PluginGroup[Any]:
        return PluginGroup("pointit.test_parts", Plugin, "part")


@pytest.mark.usefixtures("parts")
def test_plugin_with_the_name_of_a_parameter_is_refused() -> None:
    config = ServiceConfig(number=4)  # of the service
    assert [*config.sections()] == ["mine"]
    with pytest.raises(ConfigError, match="part 'number' of strangers-parts has the name of a parameter"):
        config.section("number")
    assert config.section("mine").model_dump() == {"address": "", "speed": 3}


class Listening:
    NAME = "listening"
    SCOPE = "site"
    SEVERAL = False
    CONFIG = ServiceConfig


@pytest.mark.parametrize(
    ("arguments", "others"),
    [
        (["--number", "4", "--mine.speed", "5"], 0),
        (["--mine.sped", "5"], 1),  # the error suggests an option
        (["--help"], 1),
        (["-h"], 1),
    ],
)
def test_process_imports_only_plugins_that_its_arguments_name(
    parts: PluginGroup[Plugin], tmp_path: Path, arguments: list[str], others: int
) -> None:
    command = service_command(cast("Any", Listening))
    assert "raising" in parts.names
    with contextlib.suppress(click.exceptions.Exit, click.NoSuchOption):
        command.make_context("listening", arguments, help_option_names=["-h", "--help"])
    assert len(list(tmp_path.glob("*.imported"))) == others
