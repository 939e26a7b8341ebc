"""A status line of commands that wait for a person."""

import contextlib
from collections.abc import Generator

from rich.status import Status
from rich.text import Text

from pointit.cli.common.output import say
from pointit.runtime.service.plain_console import PlainConsole


class ChangingLine:
    """A status line that changes, and lines above it that stay."""

    def __init__(self, status: Status | None) -> None:
        self._status = status

    def __call__(self, text: str) -> None:
        """Replace the status line by `text`; without a terminal, do nothing."""
        if self._status is not None:
            self._status.update(Text(text))

    def say(self, text: str) -> None:
        """Write a line that stays."""
        if self._status is None:
            say(text, err=True)
        else:  # through the console, or it would end up behind the status line
            self._status.console.print(Text(text))


@contextlib.contextmanager
def changing_line() -> Generator[ChangingLine]:
    """Yield a status line on standard error, if that is a terminal."""
    console = PlainConsole(stderr=True)
    if not console.is_terminal or console.is_dumb_terminal:
        yield ChangingLine(None)
        return
    with console.status("") as status:
        yield ChangingLine(status)
