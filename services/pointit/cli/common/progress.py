"""Long work: a bar or a spinner on a terminal, else a line every few seconds; and its interruption."""

import signal
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any, Protocol

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

LINE_EVERY_S = 10.0
"""Interval of lines without a terminal."""


class ProgressCallback(Protocol):
    """Shows the current activity and, if they can be counted, the number of finished pieces of work."""

    def __call__(self, activity: str, done: int | None = None, /) -> None:
        """Report progress."""


@contextmanager
def progress(total: int | None = None) -> Generator[ProgressCallback]:
    """Yield a callback that shows progress on standard error. `total` is the number of pieces, if known."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield LineProgress(total, lambda line: click.echo(line, err=True), time.monotonic)
        return
    columns: list[ProgressColumn] = [TextColumn("{task.description}")]
    if total is None:
        columns = [SpinnerColumn(), *columns, TimeElapsedColumn()]
    else:
        columns += [BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()]
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("reading", total=total)

        def tell(activity: str, done: int | None = None, /) -> None:
            progress.update(task, description=activity, completed=done)

        yield tell


class LineProgress:
    """Writes a line on a report if the last line, or the start, is `LINE_EVERY_S` ago."""

    def __init__(
        self, total: int | None, write: Callable[[str], object], monotonic_s: Callable[[], float]
    ) -> None:
        self._total = total
        self._write = write
        self._monotonic_s = monotonic_s
        self._began_s = self._wrote_s = monotonic_s()

    def __call__(self, activity: str, done: int | None = None, /) -> None:
        """Report progress."""
        now_s = self._monotonic_s()
        if now_s - self._wrote_s < LINE_EVERY_S:
            return
        self._wrote_s = now_s
        count = "" if done is None or self._total is None else f": {done} of {self._total}"
        self._write(f"{activity}{count}, for {now_s - self._began_s:.0f} s")


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
