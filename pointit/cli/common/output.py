"""Output of commands: tables for people, JSON for programs, lines for pipes; and progress of long work."""

import contextlib
import json
import math
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, cast

import click
from rich import box
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
from rich.table import Table
from rich.text import Text

from pointit.runtime.service.plain_console import PlainConsole
from pointit.runtime.service.plain_console import say as say  # noqa: PLC0414 - commands print by it, too
from pointit.schemas.printable import is_printable, plain

Row = Mapping[str, Any]

PIPE_WIDTH = 1000
"""Width without a terminal or the variable COLUMNS, in columns: one line per row, for grep."""

ROOMY_WIDTH = 130
"""A terminal with fewer columns does not show a table's `roomy` ones."""

_UNMINDED = re.compile("[\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]")

INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended before it had a result."""

json_option = click.option("--json", "as_json", is_flag=True, help="JSON instead of text, for programs")

LINE_EVERY_S = 10.0
"""Interval of lines without a terminal."""


@dataclass(frozen=True, kw_only=True)
class OutputSection:
    """A named table; its columns are the keys of its rows."""

    name: str
    """The key in JSON."""
    about: str
    rows: tuple[Row, ...]
    roomy: frozenset[str] = frozenset()
    """Columns shown only by wide terminals; JSON and pipes always have them."""
    whole: frozenset[str] = frozenset()
    """Columns that are never wrapped, so that their text can be copied."""


def show(sections: Sequence[OutputSection], *, as_json: bool) -> None:
    """Print `sections` as tables, or as one JSON object of lists."""
    if as_json:
        print_json({section.name: section.rows for section in sections})
        return
    screen = console()
    for section in sections:
        print_table(screen, section)


def print_table(rich_console: Console, section: OutputSection) -> None:
    """Print one section as a table under its title."""
    columns = list(section.rows[0]) if section.rows else []
    if rich_console.width < ROOMY_WIDTH:
        columns = [column for column in columns if column not in section.roomy]
    title = f"{section.name.capitalize()}: {section.about}"
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", title_style="bold", pad_edge=False)
    for column in columns:
        values = [row[column] for row in section.rows]
        is_numeric = all(isinstance(value, int | float | None) for value in values)
        table.add_column(
            column.replace("_", " "),
            justify="right" if is_numeric else "left",
            overflow="fold",
            min_width=4,
            no_wrap=column in section.whole,
        )
    for row in section.rows:
        cells = [cell(row[column]) for column in columns]
        table.add_row(*map(_harmless, cells))
    rich_console.print(table)


def cell(value: Any) -> Text:
    """Return `value` as a cell; text is not parsed as markup."""
    if isinstance(value, Text):
        return value
    if value is None or value in ("", (), []):
        return Text("-", style="dim")
    if isinstance(value, float):
        return Text(f"{value:.4g}")
    if isinstance(value, (list, tuple)):
        items = cast("Sequence[Any]", value)
        return Text(", ".join(str(item) for item in items))
    return Text(str(value))


def _harmless(text: Text) -> Text:
    """Return `text` without terminal control characters, since other processes may have written it."""
    text.plain = plain(text.plain)
    return text


def console() -> Console:
    """Return a console on standard output, as wide as the terminal, before a pager too, or as the rows."""
    is_terminal = sys.stdout.isatty()
    width = None if is_terminal or "COLUMNS" in os.environ else PIPE_WIDTH
    if not is_terminal and sys.stderr.isatty():  # `pointit list | less`
        with contextlib.suppress(OSError):
            width = os.get_terminal_size(sys.stderr.fileno()).columns or width
    return Console(markup=False, emoji=False, width=width)


def print_json(value: Any, *, indent: int | None = 2) -> None:
    """Print `value` as JSON; bytes become hexadecimal text."""
    click.echo(to_json(value, indent=indent))


def to_json(value: Any, *, indent: int | None = None) -> str:
    """Return `value` as JSON. Bytes become hexadecimal text; NaN and infinities, which JSON lacks, null."""
    is_ascii = not (sys.stdout.encoding or "utf-8").lower().startswith("utf")
    encoder = json.JSONEncoder(indent=indent, default=_plain, ensure_ascii=is_ascii, allow_nan=False)
    try:
        return _escaped(encoder.encode(value))
    except ValueError:
        return _escaped(encoder.encode(_without_nan(value)))


def to_line(value: Any) -> str:
    """Return `value` on one line in YAML's flow style: numbers with six digits, bytes as their count."""
    if isinstance(value, Mapping):
        fields: list[str] = []
        for key, inner in cast("Mapping[str, Any]", value).items():
            if inner is not None:
                fields.append(f"{_key(key)}: {to_line(inner)}")
        return "{" + ", ".join(fields) + "}"
    if isinstance(value, (list, tuple)):
        items = [to_line(item) for item in cast("Sequence[Any]", value)]
        return f"[{', '.join(items)}]"
    if isinstance(value, bytes):
        return f"<{len(value)} bytes>"
    if isinstance(value, float):
        return _number(value)
    return _escaped(json.dumps(value, ensure_ascii=False))


def _key(key: str) -> str:
    if is_printable(key):
        return key
    return _escaped(json.dumps(key, ensure_ascii=False))


def _escaped(text: str) -> str:
    return _UNMINDED.sub(_escape, text)


def _escape(character: re.Match[str]) -> str:
    return f"\\u{ord(character[0]):04x}"


def duration_text(seconds: float) -> str:
    """Return a duration as people say it: `12 s`, `3 min`, `5 h`."""
    if seconds < 100:
        return f"{max(seconds, 0):.0f} s"
    if seconds < 100 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.0f} h"


def print_file(content: str | bytes) -> None:
    """Print what a file would have. A pipe gets it in UTF-8, as files are, whatever its encoding."""
    if isinstance(content, str) and not sys.stdout.isatty():
        content = content.encode()
    click.echo(content, nl=False)


def write_line(line: str) -> bool:
    """Write `line` and flush. Return False if the pipe was closed by its reader, which is not an error."""
    try:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        # Python flushes again at exit; its documentation recommends this to avoid an error then.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return False
    return True


def _number(value: float) -> str:
    digits, exponent_sign, exponent = f"{value:.6g}".partition("e")
    if "." not in digits:  # YAML requires the point
        digits += ".0"
    return f"{digits}{exponent_sign}{exponent}"


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        fields = cast("Mapping[str, Any]", value)
        return {key: _without_nan(inner) for key, inner in fields.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(item) for item in cast("Sequence[Any]", value)]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.hex()
    raise TypeError(f"cannot be shown as JSON: {type(value).__name__}")


class ProgressCallback(Protocol):
    """Shows the current activity and, if they can be counted, the number of finished pieces of work."""

    def __call__(self, activity: str, done: int | None = None, /) -> None:
        """Report progress."""


@contextmanager
def progress(total: int | None = None) -> Generator[ProgressCallback]:
    """Yield a callback that shows progress on standard error. `total` is the number of pieces, if known."""
    console = PlainConsole(stderr=True)
    if not console.is_terminal or console.is_dumb_terminal:
        yield LineProgress(total, lambda line: click.echo(line, err=True), time.monotonic)
        return
    columns: list[ProgressColumn] = [TextColumn("{task.description}", markup=False)]
    if total is None:
        columns = [SpinnerColumn(), *columns, TimeElapsedColumn()]
    else:
        columns += [BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()]
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=total)

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
        elapsed_s = now_s - self._began_s
        count = ""
        if done is not None and self._total is not None:
            count = f": {done} of {self._total}"
        self._write(f"{activity}{count}, for {elapsed_s:.0f} s")


def _interrupt(_number: int, _frame: object) -> None:
    signal.raise_signal(signal.SIGINT)


@contextmanager
def interruptible() -> Generator[None]:
    """Make Ctrl-C and SIGTERM raise `KeyboardInterrupt` inside, so that everything there is cleaned up.

    While `asyncio` runs a task inside, they cancel it first.
    """
    previous_sigint = signal.signal(signal.SIGINT, signal.default_int_handler)
    previous_sigterm = signal.signal(signal.SIGTERM, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous_sigint)
        signal.signal(signal.SIGTERM, previous_sigterm)
