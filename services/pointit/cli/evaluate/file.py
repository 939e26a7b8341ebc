"""Where an evaluation's results go: files for programs, refused before the work; and how it is ended."""

import os
import signal
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.output import to_json
from pointit.runtime.errors import ConfigError


def check_writable(file: Path | None, option: str = "--json") -> None:
    """Refuse, before the work of minutes, a file that cannot be written.

    Args:
        file: none: it is not wanted; `-`: standard output.
        option: that named it, for the sentence.

    Raises:
        ConfigError: it is a folder, its folder is not there or not writable.
    """
    if file is None or str(file) == "-":
        return
    if file.is_dir():
        raise ConfigError(f"{option} {file}: is a folder; give a file")
    there = file if file.exists() else file.parent
    if not os.access(there, os.W_OK):
        raise ConfigError(f"{option} {file}: cannot be written; give a file in a folder that is yours")


def write_json(document: dict[str, Any], file: Path | None) -> bool:
    """Write `document` where asked. Return True if standard output is taken by it.

    Raises:
        ConfigError: the file cannot be written.
    """
    if file is None:
        return False
    text = to_json(document, indent=2)
    if str(file) == "-":
        click.echo(text)
        return True
    try:
        file.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written ({error.strerror or error})") from error
    return False


@contextmanager
def interruptible() -> Generator[None]:
    """Have Ctrl-C and SIGTERM raise inside, so that processes are ended and the terminal is as it was."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before: list[Any] = [signal.signal(number, signal.default_int_handler) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
