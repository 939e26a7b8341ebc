"""Commands within the text of documents: their options exist."""

import re
import shlex
from collections.abc import Iterator

import click
import pytest

from pointit.cli.main import front
from tests.docs.blocks import ROOT, pages

COMMAND = re.compile(r"`(pointit [^`\n]+)`")


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
