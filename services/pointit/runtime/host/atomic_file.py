"""Files that are read with a limit, and replaced as a whole: readers find the old or the new content."""

import contextlib
import errno
import os
import secrets
import sys
from collections.abc import Generator
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
    with replaced_file(path, mode=mode, durable=durable) as part:
        part.write_bytes(content)


@contextlib.contextmanager
def replaced_file(path: Path, *, mode: int | None = None, durable: bool = False) -> Generator[Path]:
    """Yield the path of a new file. It replaces `path` when the body ends, or is deleted if the body raises.

    `mode` and `durable` are those of `write_atomically`. Without a mode, for files of a user, it is the mode
    of the replaced file, or the system's default. Then links are followed, a write-protected file is an
    error, and a path that is no regular file, such as /dev/stdout or a pipe, is yielded itself.

    Raises:
        ConfigError: If it cannot be written, which leaves `path` as it was. Names the file.
    """
    try:
        target = path.resolve() if mode is None else path
        if mode is not None:
            for folder in reversed(path.parents):  # `parents=True` would give its mode to the last one only
                folder.mkdir(exist_ok=True, mode=0o700)
        elif path.parts[1:2] in (("dev",), ("proc",)) or (target.exists() and not target.is_file()):
            yield path
            return
        elif target.exists():
            if not os.access(target, os.W_OK):
                raise PermissionError(errno.EACCES, "it is write-protected")
            mode = target.stat().st_mode
        # the suffix tells writers the format
        part = target.with_name(f".{target.stem[:100]}.{secrets.token_hex(4)}{target.suffix}")
        try:
            part.touch(0o666 if mode is None else 0o600, exist_ok=False)
            yield part
            if durable:
                _sync(part)
            if mode is not None:
                part.chmod(mode)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
        if durable:
            _sync(path.parent)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror or error})") from error


def _sync(path: Path) -> None:
    is_folder = path.is_dir()
    if is_folder and sys.platform == "win32":  # it opens no folders
        return
    handle = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
