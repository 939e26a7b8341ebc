"""Interruption of long work that has to clean up."""

import signal
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any


def _interrupt(_number: int, _frame: object) -> None:
    signal.raise_signal(signal.SIGINT)


@contextmanager
def interruptible() -> Generator[None]:
    """Make Ctrl-C and SIGTERM raise `KeyboardInterrupt` inside, so that everything there is cleaned up.

    While `asyncio` runs a task inside, they cancel it first.
    """
    before: dict[int, Any] = {
        signal.SIGINT: signal.signal(signal.SIGINT, signal.default_int_handler),
        signal.SIGTERM: signal.signal(signal.SIGTERM, _interrupt),
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
