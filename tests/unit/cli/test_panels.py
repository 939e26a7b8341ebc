"""Options of `run` and `person add` are shown once, in panels."""

import re

import click
import pytest
from click.testing import CliRunner

from pointit.cli.common.panels import PanelCommand
from pointit.cli.main import command


def loaded(words: str) -> PanelCommand:
    found: click.Command | None = command
    with click.Context(command) as context:
        for word in words.split():
            assert isinstance(found, click.Group)
            found = found.get_command(context, word)
    assert isinstance(found, PanelCommand)
    return found


@pytest.mark.parametrize("words", ["run", "person add"])
def test_every_option_is_shown_once(words: str) -> None:
    text = CliRunner().invoke(command, [*words.split(), "--help"], prog_name="pointit").output
    found = loaded(words)
    options = [option for option in found.params if isinstance(option, click.Option)]
    for option in options:
        assert len(re.findall(rf"^  {option.opts[0]}\b(?!-)", text, re.MULTILINE)) == 1, option.opts
    assert all(f"\n{heading}:\n" in text for heading in (*found.panels, "Other options"))


def test_panels_name_only_options() -> None:
    both = [loaded("run"), loaded("person add")]
    options = {option.name for each in both for option in each.params}
    assert {name for each in both for names in each.panels.values() for name in names} <= options
