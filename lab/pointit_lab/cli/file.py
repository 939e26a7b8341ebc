"""Result files of an evaluation, checked before the work."""

import os
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.output import to_json
from pointit.runtime.errors import ConfigError


def check_writable(file: Path | None, option: str = "--json") -> None:
    """Check before minutes of work that `file` can be written.

    Args:
        file: None: not requested. `-`: standard output.
        option: name of the option, for the message.

    Raises:
        ConfigError: If it is a folder, or its folder is missing or not writable.
    """
    if file is None or str(file) == "-":
        return
    if file.is_dir():
        raise ConfigError(f"{option} {file}: is a folder; give a file")
    there = file if file.exists() else file.parent
    if not os.access(there, os.W_OK):
        raise ConfigError(f"{option} {file}: cannot be written; give a file in a folder of yours")


def write_json(document: dict[str, Any], file: Path | None) -> bool:
    """Write `document` to `file`, if given. Return True if that is standard output.

    Raises:
        ConfigError: If the file cannot be written.
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
