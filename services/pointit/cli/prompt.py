"""Waiting for a person: Enter on the keyboard, and a line that changes while they do something."""

import asyncio
import contextlib
from collections.abc import Callable, Generator

import click
from rich.console import Console

from pointit.cli.keyboard import has_keyboard, keys
from pointit.cli.lazy import Mistake


async def enter(text: str, otherwise: str) -> None:
    """Print `text` and wait for Enter or Space.

    Raises:
        Mistake: there is no keyboard; `otherwise` is the option that does without.
    """
    if not has_keyboard():
        raise Mistake(f"there is no keyboard to press Enter on; use {otherwise}")
    click.echo(text, err=True)
    pressed = asyncio.Event()
    with keys(pressed.set):
        await pressed.wait()


@contextlib.contextmanager
def changing_line() -> Generator[Callable[[str], None]]:
    """Yield what shows a line in place of the one before, on a terminal; elsewhere it shows nothing."""
    console = Console(stderr=True)
    if not console.is_terminal or console.is_dumb_terminal:
        yield lambda _text: None
        return
    with console.status("") as status:

        def show(text: str) -> None:
            status.update(text)

        yield show
