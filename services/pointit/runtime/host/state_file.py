"""Persistent state: small JSON files under the state directory, one per person and purpose."""

import contextlib
import os
from collections.abc import Generator
from contextvars import ContextVar
from pathlib import Path
from typing import Generic, Self, TypeVar

import platformdirs
from pydantic import BaseModel, ValidationError

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.atomic_file import read_limited, write_atomically
from pointit.schemas import summarize_validation_error
from pointit.schemas.topics import check_name

T = TypeVar("T", bound=BaseModel)
VARIABLE = "POINTIT_STATE"
"""Names another state directory."""
MAX_BYTES = 64 * 1024


_used: ContextVar[Path | None] = ContextVar("state directory", default=None)


@contextlib.contextmanager
def using_state_directory(path: Path) -> Generator[None]:
    """Use `path` as the state directory in this block and in all tasks that it starts."""
    before = _used.set(path)
    try:
        yield
    finally:
        _used.reset(before)


def state_directory() -> Path:
    """Return the state directory: `$POINTIT_STATE`, or the system's default. It need not exist.

    Raises:
        ConfigError: If neither the variable nor a home directory is set.
    """
    if (used := _used.get()) is not None:
        return used
    named = os.environ.get(VARIABLE, "")
    try:
        return Path(named) if named else platformdirs.user_state_path("pointit", appauthor=False)
    except RuntimeError as error:  # a user id without a name, and no HOME
        raise ConfigError(f"there is no home directory; set HOME, or {VARIABLE} to a folder") from error


def expand_home(text: str) -> Path:
    """Return the path `text`, in which `~` and `~USER` are a home directory.

    Raises:
        ConfigError: If there is none.
    """
    try:
        return Path(text).expanduser()
    except RuntimeError as error:
        raise ConfigError(f"{text}: there is no such home directory; set HOME, or write the path") from error


def site_folder(site: str, service: str) -> Path:
    """Return the folder of `service` for data of `site` that must not be lost. It need not exist.

    Raises:
        KeyNameError: If `site` cannot be a name.
    """
    check_name(site, "site")
    return state_directory() / site / service


def plugin_folder(site: str, user: str, kind: str, name: str) -> Path:
    """Return the folder of the plug-in `name` of a `kind`, for `user`, or for all of `site` if that is `""`.

    Raises:
        KeyNameError: If `site` or `user` cannot be a name.
    """
    owner = state_directory() / "users" / check_name(user, "user") if user else site_folder(site, "")
    return owner / "plugins" / kind / name


class StateFile(Generic[T]):
    """One person's `purpose`, such as `offset`, as a `model` in JSON."""

    _remedy = "move it away and calibrate again"

    def __init__(self, model: type[T], user: str, purpose: str) -> None:
        """Create without opening any file.

        Raises:
            KeyNameError: If `user` cannot be a name.
        """
        check_name(user, "user")
        self._model = model
        self.path = state_directory() / "users" / user / f"{purpose}.json"

    @classmethod
    def at(cls, path: Path, model: type[T]) -> Self:
        """Return the state file at `path` for a `model`, as for a plug-in's value. Opens no file yet."""
        file = cls.__new__(cls)
        file.path, file._model, file._remedy = path, model, "move it away"  # noqa: SLF001 - its own
        return file

    def read(self) -> T | None:
        """Return the stored value, or None.

        Raises:
            ConfigError: If a value is stored, but cannot be read or used. Names the file.
        """
        try:
            data = read_limited(self.path, MAX_BYTES + 1)
            if len(data) > MAX_BYTES:
                raise ConfigError(f"{self.path}: is too long to be ours; {self._remedy}")
            return self._model.model_validate_json(data)
        except FileNotFoundError:
            return None
        except ValidationError as error:
            raise ConfigError(
                f"{self.path}: cannot be used; {self._remedy}; {summarize_validation_error(error)}"
            ) from error

    def write(self, value: T) -> None:
        """Replace the stored value by `value`, atomically and readable by its owner only.

        Raises:
            ConfigError: If it cannot be written. Names the file.
        """
        write_atomically(self.path, (value.model_dump_json(indent=2) + "\n").encode())

    def erase(self) -> bool:
        """Erase the stored value. Return True if there was one.

        Raises:
            ConfigError: If it cannot be erased. Names the file.
        """
        try:
            self.path.unlink()
        except FileNotFoundError:
            return False
        except OSError as error:
            raise ConfigError(f"{self.path}: cannot be erased ({error.strerror or error})") from error
        return True
