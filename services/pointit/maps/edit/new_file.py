"""Writes new maps: a file that exists is never replaced."""

import os
from pathlib import Path

from pointit.runtime.errors import ConfigError


def write_new(path: Path, text: str | bytes) -> None:
    """Write `text` to a new file, which is there once it is complete.

    Raises:
        ConfigError: If it exists already, or cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        try:
            with part.open("xb") as opened:
                opened.write(text.encode() if isinstance(text, str) else text)
            _rename_to_new(part, path)
        finally:
            part.unlink(missing_ok=True)
    except FileExistsError as error:
        raise ConfigError(f"{path}: exists already; choose another name or move it away") from error
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror or error})") from error


def _rename_to_new(part: Path, path: Path) -> None:
    """Give the file `part` the name `path` if no file has it. FAT has no links and may lose a race."""
    try:
        path.hardlink_to(part)
    except FileExistsError:
        raise
    except OSError:
        if path.exists():
            raise FileExistsError from None
        part.rename(path)
