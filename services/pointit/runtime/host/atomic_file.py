"""Files that are replaced as a whole: whoever reads one finds the old or the new, never half of it."""

import os
import sys
import tempfile
from pathlib import Path

from pointit.runtime.errors import ConfigError


def write_atomically(path: Path, content: bytes, *, mode: int = 0o600, durable: bool = False) -> None:
    """Put `content` in the place of `path`, all of it or nothing; new folders are the owner's alone.

    Args:
        path: of the file; what it is in need not exist.
        content: all of it.
        mode: of the file; until it is complete only its owner can read it, whatever is said here.
        durable: return only when it would outlive a power cut.

    Raises:
        ConfigError: it cannot be written; names the file.
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
    """Wait until the names in `folder` are on the disk."""
    if sys.platform == "win32":  # it opens no folders
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
