"""Files of a site: read with a size limit, changed by one writer at a time."""

import contextlib
import sys
from collections.abc import Generator
from pathlib import Path

from pointit.runtime.errors import ConfigError

LOCK = ".lock"
MAX_BYTES = 16 * 1024 * 1024


def read(path: Path) -> bytes:
    """Return the content of `path`.

    Raises:
        FileNotFoundError: If there is no file.
        ConfigError: If it cannot be read. Names the file.
    """
    try:
        with path.open("rb") as file:
            return file.read(MAX_BYTES)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error


@contextlib.contextmanager
def locked(folder: Path) -> Generator[None]:
    """Lock the folder in the context. It is created if missing.

    Raises:
        ConfigError: If another process changes it, or it cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        file = (folder / LOCK).open("ab")
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written ({error.strerror or error})") from error
    with file:
        try:
            _hold(file.fileno())
        except OSError as error:
            raise ConfigError(f"{folder}: another process is changing it; try again in a moment") from error
        yield


if sys.platform == "win32":
    import msvcrt

    def _hold(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _hold(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
