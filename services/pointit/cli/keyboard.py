"""The keyboard beside a live view: keys are not echoed into it, and Space or Enter is a person's button."""

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable, Generator

BUTTON_KEYS = frozenset(b" \n\r")


def has_keyboard() -> bool:
    """Return whether keys can be read one by one: a terminal of a system that has termios."""
    return os.name == "posix" and sys.stdin.isatty()


@contextlib.contextmanager
def keys(on_button: Callable[[], None]) -> Generator[None]:
    """Call `on_button` for each Space or Enter; the terminal is as before afterwards.

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
        elif BUTTON_KEYS & set(data):
            on_button()

    tty.setcbreak(terminal, termios.TCSANOW)  # Ctrl-C stays a signal
    loop.add_reader(terminal, read)
    try:
        yield
    finally:
        loop.remove_reader(terminal)
        termios.tcsetattr(terminal, termios.TCSANOW, before)
