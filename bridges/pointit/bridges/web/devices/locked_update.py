"""Changes of a stored value that several processes write."""

import contextlib
import sqlite3
from collections.abc import Callable
from typing import TypeVar

from pydantic import BaseModel

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.host.store import acquire_lock

T = TypeVar("T", bound=BaseModel)
LOCK_TIMEOUT_S = 2.0


def update_stored(file: StateFile[T], change: Callable[[T | None], T]) -> None:
    """Replace the stored value by `change(value)`. Other processes that update it wait.

    Raises:
        ConfigError: If a value cannot be read, used or written, or is locked for `LOCK_TIMEOUT_S`.
    """
    path = file.path
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        lock = acquire_lock(path.with_suffix(".lock"), LOCK_TIMEOUT_S)
    except (OSError, sqlite3.Error) as error:
        raise ConfigError(f"{path}: cannot be locked ({error})") from error
    if lock is None:
        raise ConfigError(f"{path}: another process is changing it; try again in a moment")
    with contextlib.closing(lock):
        file.write(change(file.read()))
