"""The keyboard during a command: Enter, or Space as a person's button in a live view."""

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable, Generator

import click

from pointit.cli.common.lazy import UnknownNameError

BUTTON_KEYS = frozenset(b" \n\r")


def has_keyboard() -> bool:
    """Return True if single keys can be read: standard input is a terminal, and there is termios."""
    return os.name == "posix" and sys.stdin.isatty()


@contextlib.contextmanager
def keys(on_button: Callable[[], None]) -> Generator[None]:
    """Call `on_button` for each Space or Enter; restore the terminal on exit.

    Must be entered in the event loop, and only when `has_keyboard`.
    """

    def press(data: bytes) -> None:
        if BUTTON_KEYS & set(data):
            on_button()

    with key_bytes(press):
        yield


@contextlib.contextmanager
def key_bytes(on_bytes: Callable[[bytes], None]) -> Generator[None]:
    """Call `on_bytes` with the terminal's bytes for pressed keys. Restore the terminal on exit.

    Must be entered in the event loop, and only when `has_keyboard`.
    """
    import termios  # noqa: PLC0415 - not on Windows
    import tty  # noqa: PLC0415

    terminal = sys.stdin.fileno()
    loop = asyncio.get_running_loop()
    before = termios.tcgetattr(terminal)

    # The loop reads what is pressed, so that no thread waits for a key after the end
    def read() -> None:
        data = os.read(terminal, 64)
        if not data:  # the terminal is gone
            loop.remove_reader(terminal)
        else:
            on_bytes(data)

    tty.setcbreak(terminal, termios.TCSANOW)  # Ctrl-C stays a signal
    loop.add_reader(terminal, read)
    try:
        yield
    finally:
        loop.remove_reader(terminal)
        termios.tcsetattr(terminal, termios.TCSANOW, before)


def check_keyboard(otherwise: str) -> None:
    """Check that Enter can be pressed.

    Raises:
        UnknownNameError: If there is no keyboard; `otherwise` is the option that needs none.
    """
    if not has_keyboard():
        raise UnknownNameError(f"there is no keyboard to press Enter on; use {otherwise}")


async def wait_for_enter(text: str, otherwise: str) -> None:
    """Print `text` and wait for Enter or Space.

    Raises:
        UnknownNameError: If there is no keyboard; `otherwise` is the option that needs none.
    """
    check_keyboard(otherwise)
    click.echo(text, err=True)
    pressed = asyncio.Event()
    with keys(pressed.set):
        await pressed.wait()
