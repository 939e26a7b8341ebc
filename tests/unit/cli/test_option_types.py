"""A number that is none is refused by every command that takes numbers."""

import click
import pytest
from click.testing import CliRunner

from pointit.cli.common.lazy import LazyGroup
from pointit.cli.main import front


def options(command: click.Command, path: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], click.Option]]:
    found = [
        (path, option)
        for option in command.params
        if isinstance(option, click.Option) and isinstance(option.type, click.FloatRange)
    ]
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            if inner is not None and (*path, name) != ("service", "run"):  # pydantic checks parameters
                found += options(inner, (*path, name))
    return found


NUMBERS = options(front())


def test_there_are_numbers_to_look_at() -> None:
    assert isinstance(front(), LazyGroup)
    assert len(NUMBERS) > 8


@pytest.mark.parametrize(("path", "option"), NUMBERS, ids=lambda value: str(getattr(value, "name", value)))
def test_nan_is_no_number(path: tuple[str, ...], option: click.Option) -> None:
    with pytest.raises(click.BadParameter, match="finite"):
        option.type.convert("nan", option, None)
    del path


def test_the_command_says_so() -> None:
    result = CliRunner().invoke(front(), ["person", "pose", "anna", "1", "2", "--yaw", "nan"])
    assert result.exit_code == 2
    assert "not a finite number" in result.output
