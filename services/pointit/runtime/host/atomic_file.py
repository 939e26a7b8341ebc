"""Files that are read with a limit, and replaced as a whole: readers find the old or the new content."""

import os
import sys
import tempfile
from pathlib import Path

from pointit.runtime.errors import ConfigError


def read_limited(path: Path, max_bytes: int) -> bytes:
    """Return the first `max_bytes` bytes of the file at `path`.

    Raises:
        FileNotFoundError: If there is no file.
        ConfigError: If it cannot be read. Names the file.
    """
    try:
        with path.open("rb") as file:
            return file.read(max_bytes)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error


def write_atomically(path: Path, content: bytes, *, mode: int = 0o600, durable: bool = False) -> None:
    """Replace `path` by `content` atomically. New folders are accessible to the owner only.

    The folder need not exist. Until the file is complete, only its owner can read it. `durable`: return only
    when it would survive a power failure.

    Raises:
        ConfigError: If it cannot be written. Names the file.
    """
    try:
        for folder in reversed(path.parents):  # `parents=True` would give its mode to the last one only
            folder.mkdir(exist_ok=True, mode=0o700)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}")  # mode 0600
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                if durable:
                    file.flush()
                    os.fsync(file.fileno())
            Path(name).chmod(mode)
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
        if durable:
            _settle(path.parent)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror or error})") from error


def _settle(folder: Path) -> None:
    if sys.platform == "win32":  # it opens no folders
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
