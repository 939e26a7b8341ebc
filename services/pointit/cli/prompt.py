"""Waiting for a person: Enter on the keyboard, and a line that changes while they do something."""

import asyncio
import contextlib
from collections.abc import Generator

import click
from rich.status import Status
from rich.text import Text

from pointit.cli.keyboard import has_keyboard, keys
from pointit.cli.lazy import Mistake
from pointit.cli.output import say
from pointit.runtime.console import PlainConsole


def check_keyboard(otherwise: str) -> None:
    """Check that somebody can press Enter.

    Raises:
        Mistake: If there is no keyboard; `otherwise` is the option that does without.
    """
    if not has_keyboard():
        raise Mistake(f"there is no keyboard to press Enter on; use {otherwise}")


async def enter(text: str, otherwise: str) -> None:
    """Print `text` and wait for Enter or Space.

    Raises:
        Mistake: there is no keyboard; `otherwise` is the option that does without.
    """
    check_keyboard(otherwise)
    click.echo(text, err=True)
    pressed = asyncio.Event()
    with keys(pressed.set):
        await pressed.wait()


class ChangingLine:
    """A line that changes while something goes on, and lines above it that stay."""

    def __init__(self, status: Status | None) -> None:
        self._status = status

    def __call__(self, text: str) -> None:
        """Show `text` in place of the one before; where no terminal can, nothing."""
        if self._status is not None:
            self._status.update(Text(text))

    def say(self, text: str) -> None:
        """Write a line that stays."""
        if self._status is None:
            say(text, err=True)
        else:  # not past the console: it would end up behind the line that changes
            self._status.console.print(Text(text))


@contextlib.contextmanager
def changing_line() -> Generator[ChangingLine]:
    """Yield a line on standard error that changes, on a terminal."""
    console = PlainConsole(stderr=True)
    if not console.is_terminal or console.is_dumb_terminal:
        yield ChangingLine(None)
        return
    with console.status("") as status:
        yield ChangingLine(status)
