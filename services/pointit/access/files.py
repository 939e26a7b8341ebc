"""Lock of a site's folder: it is changed by one writer at a time."""

import contextlib
import sys
from collections.abc import Generator
from pathlib import Path

from pointit.runtime.errors import ConfigError

LOCK = ".lock"


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
