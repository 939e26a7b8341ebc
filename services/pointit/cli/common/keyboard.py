"""The keyboard during a live view: keys are not echoed, and Space or Enter is a person's button."""

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable, Generator

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
