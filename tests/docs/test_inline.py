"""Commands within the text of documents: their options exist."""

import re
import shlex
from collections.abc import Iterator

import click
import pytest

from pointit.cli.main import front
from pointit.runtime.errors import ConfigError
from pointit.services.imu_bridge.sources import SOURCES
from pointit.services.led_driver.outputs import OUTPUTS
from tests.docs.blocks import ROOT, pages

COMMAND = re.compile(r"`(pointit [^`\n]+)`")
DEVICE = re.compile(r"--(imu|output) ([a-z][a-z0-9_-]*)(:[^\s`)]+)?")
"""A device as typed: option, name, value."""
GROUPS = {"imu": SOURCES, "output": OUTPUTS}
NO_PLUGIN = {"sim", "page", "simulated", "recorded"}
"""Words that the options know themselves."""
MADE_BY_READERS = "my-wrist"
"""Plug-in that a page writes. It needs a value, as `pointit plugin new` and `plugin list` print."""


def problems(text: str) -> Iterator[str]:
    """Yield the commands in backticks whose options do not exist."""
    for written in COMMAND.findall(text):
        words = shlex.split(written.replace("…", ""))[1:]
        command: click.Command = front()
        context = click.Context(command, **command.context_settings)  # click remembers the names of help
        while words and isinstance(command, click.Group):
            inner = command.get_command(context, words[0])
            if inner is None:
                break  # a placeholder; names of commands have a test in tests/architecture
            command = inner
            words = words[1:]
        options = {"--help"}.union(
            *((*each.opts, *each.secondary_opts) for each in command.get_params(context))
        )
        for word in words:
            if word.startswith("--") and word.partition("=")[0] not in options:
                yield f"{written}: no option {word}"


@pytest.mark.parametrize("page", [str(page.relative_to(ROOT)) for page in pages()])
def test_options_of_commands_in_the_text_exist(page: str) -> None:
    assert list(problems((ROOT / page).read_text(encoding="utf-8"))) == []


def test_a_wrong_option_is_named() -> None:
    text = "`pointit run scenario_4 --users 2 --colour red` or `pointit map plot --person=1,2`"
    assert [problem.partition(": ")[2] for problem in problems(text)] == ["no option --colour"]


def unreadable(text: str) -> Iterator[str]:
    """Yield the devices in `text` that their option refuses."""
    for option, name, value in DEVICE.findall(text):
        typed = f"{name}{value.rstrip(':.,;')}"
        if name == MADE_BY_READERS and value:
            continue
        if name in NO_PLUGIN and not value:
            continue
        try:
            GROUPS[option].choose(typed)
        except ConfigError as error:
            yield f"--{option} {typed}: {error}"


@pytest.mark.parametrize("page", [str(page.relative_to(ROOT)) for page in pages()])
def test_devices_in_the_text_are_read_by_their_option(page: str) -> None:
    assert list(unreadable((ROOT / page).read_text(encoding="utf-8"))) == []


def test_devices_without_a_needed_value_are_named() -> None:
    text = "`--imu my-wrist --output ddp`, `--imu my-wrist:192.168.1.20 --imu serial --imu page`"
    found = [problem.partition(": ")[0] for problem in unreadable(text)]
    assert found == ["--imu my-wrist", "--output ddp"]
