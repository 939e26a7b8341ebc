"""Persistent state: small JSON files, one per person and purpose, each replaced as a whole."""

import contextlib
import errno
import os
import shlex
import sys
from collections.abc import Generator
from contextvars import ContextVar
from pathlib import Path
from typing import Generic, Self, TypeVar

import platformdirs
from pydantic import BaseModel, ValidationError

from pointit.runtime.errors import ConfigError
from pointit.runtime.machine import this_machine
from pointit.schemas import summarize_validation_error
from pointit.schemas.text import system_reason
from pointit.schemas.topics import check_name

T = TypeVar("T", bound=BaseModel)

GROUP = 0o070
"""Rights of the group."""
OTHERS = 0o007
"""Rights of others."""
NO_MODES = "its file system keeps no rights of its own (a drive of Windows, exFAT or Samba)"
"""Reason for which no file in a folder can be its owner's alone."""
VARIABLE = "POINTIT_STATE"
"""Names another state directory."""
MAX_BYTES = 64 * 1024
"""Maximum size of a state file, unless its owner says another."""

_used: ContextVar[Path | None] = ContextVar("state directory", default=None)


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
        raise ConfigError(f"{path}: cannot be read ({system_reason(error)})") from error


def read_secret(path: Path, max_bytes: int) -> bytes:
    """Return the first `max_bytes` bytes of the file at `path`, which only its owner may read.

    A file of another owner may be for a group, such as that of a service, and a mount without writing, such
    as that of a container's secrets, has whatever rights the container's engine gives.

    Raises:
        FileNotFoundError: If there is no file.
        ConfigError: If it cannot be read, or others can read it. Names the file.
    """
    content = read_limited(path, max_bytes)
    if os.name != "posix" or not path.is_file():
        return content
    if os.statvfs(path).f_flag & os.ST_RDONLY:
        return content
    status = path.stat()
    others = OTHERS
    if status.st_uid == os.geteuid():
        others |= GROUP
    if status.st_mode & others:
        if not keeps_modes(path.parent):
            raise ConfigError(f"{path}: others can read it, as {NO_MODES}: move it into your home directory")
        command = f"chmod 600 {shlex.quote(str(path))}"
        raise ConfigError(f"{path}: others can read it; make it yours alone with `{command}`")
    return content


def keeps_modes(folder: Path) -> bool:
    """Return True if files in `folder` can be their owner's alone. Writes a file there, and removes it.

    Drives of Windows in WSL, exFAT and Samba have the same mode for all files, and ignore `chmod`. A folder
    that cannot be written to counts as one that keeps modes.
    """
    if os.name != "posix":
        return True
    part = part_of_file(folder / "modes")
    try:
        with part.open("xb"):
            part.chmod(0o600)
            return not part.stat().st_mode & (GROUP | OTHERS)
    except PermissionError:  # of `chmod`: such file systems refuse it, or ignore it
        return not part.exists()
    except OSError:
        return True
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def write_atomically(path: Path, content: bytes, *, mode: int = 0o600, durable: bool = False) -> None:
    """Replace `path` by `content` atomically. New folders are accessible to the owner only.

    The folder need not exist. Until the file is complete, only its owner can read it. `durable`: return only
    when it would survive a power failure.

    Raises:
        ConfigError: If it cannot be written. Names the file.
    """
    with replaced_file(path, mode=mode, durable=durable) as part:
        part.write_bytes(content)


def create_atomically(path: Path, content: bytes) -> bool:
    """Create `path` with `content`, for its owner only. Return False, and change nothing, if it exists.

    Of several processes that do so at once, one succeeds.

    Raises:
        ConfigError: If it cannot be written. Names the file.
    """
    part = part_of_file(path)
    write_atomically(part, content)
    is_new = True
    try:
        rename_to_new(part, path)
    except FileExistsError:
        is_new = False
    finally:
        part.unlink(missing_ok=True)
    return is_new


def part_of_file(path: Path) -> Path:
    """Return a path for a part of the file at `path`, which no process uses, and no dead one has used."""
    stem = path.stem[:100]
    unique = this_machine().random_name(4)
    return path.with_name(f".{stem}.{unique}{path.suffix}")  # writers need the suffix


def rename_to_new(part: Path, path: Path) -> None:
    """Give the file `part` the name `path` if no file has it. FAT has no links and may lose a race.

    Raises:
        FileExistsError: If a file has the name.
        OSError: If it cannot be given. `part` may still be there otherwise, too.
    """
    try:
        path.hardlink_to(part)
    except FileExistsError:
        raise
    except OSError:
        if path.exists():
            raise FileExistsError from None
        part.rename(path)


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
        elif _is_special(path, target):
            yield path
            return
        elif target.exists():
            if not os.access(target, os.W_OK):
                raise PermissionError(errno.EACCES, "it is write-protected")
            mode = target.stat().st_mode
        # Readers see the old content or the new one. A rename replaces only within one folder.
        part = part_of_file(target)
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
        raise ConfigError(f"{path}: cannot be written ({system_reason(error)})") from error


def _is_special(path: Path, target: Path) -> bool:
    """Return True for devices and pipes, which are written to and not replaced."""
    if path.parts[1:2] in (("dev",), ("proc",)):
        return True
    return target.exists() and not target.is_file()


def _sync(path: Path) -> None:
    is_folder = path.is_dir()
    if is_folder and sys.platform == "win32":  # it opens no folders
        return
    handle = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def using_state_directory(path: Path) -> Generator[None]:
    """Use `path` as the state directory in this block and in all tasks that it starts."""
    previous = _used.set(path)
    try:
        yield
    finally:
        _used.reset(previous)


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
    if user:
        owner = state_directory() / "users" / check_name(user, "user")
    else:
        owner = site_folder(site, "")
    return owner / "plugins" / kind / name


class StateFile(Generic[T]):
    """One value on disk that survives restarts, such as the offset of a person: a pydantic `model` as JSON.

    It is written whole and atomically, so a reader sees the old value or the new one, also after a kill or a
    power failure, and only its owner can read it. `StateFile(Offset, "anna", "offset")` is a person's file,
    and `StateFile.at` one at any path, as plug-ins use it.

        file = StateFile.at(folder / "count.json", Count)
        count = file.read() or Count()              # None if there is none yet
        file.write(Count(total=count.total + 1))

    A file that cannot be used is an error that names it, never silently a new beginning.
    """

    _remedy = "move it away and calibrate again"

    def __init__(self, model: type[T], user: str, purpose: str) -> None:
        """Create without opening any file.

        Raises:
            KeyNameError: If `user` cannot be a name.
        """
        check_name(user, "user")
        self._model = model
        self._max_bytes = MAX_BYTES
        self.path = state_directory() / "users" / user / f"{purpose}.json"

    @classmethod
    def at(cls, path: Path, model: type[T], max_bytes: int = MAX_BYTES) -> Self:
        """Return the state file at `path` for a `model`, as for a plug-in's value. Opens no file yet.

        A value that would have more than `max_bytes` is neither written nor read.
        """
        file = cls.__new__(cls)
        file.path, file._model, file._remedy = path, model, "move it away"  # noqa: SLF001 - its own
        file._max_bytes = max_bytes  # noqa: SLF001 - its own
        return file

    def read(self) -> T | None:
        """Return the stored value, or None.

        Raises:
            ConfigError: If a value is stored, but cannot be read or used. Names the file.
        """
        try:
            data = read_limited(self.path, self._max_bytes + 1)
            if len(data) > self._max_bytes:
                raise ConfigError(f"{self.path}: is too long to be ours; {self._remedy}")
            return self._model.model_validate_json(data)
        except FileNotFoundError:
            return None
        except ValidationError as error:
            mistakes = summarize_validation_error(error)
            raise ConfigError(f"{self.path}: cannot be used; {self._remedy}; {mistakes}") from error

    def write(self, value: T) -> None:
        """Replace the stored value by `value`, atomically and readable by its owner only.

        Raises:
            ConfigError: If it cannot be written, or could not be read again: the stored value stays then.
                Names the file.
        """
        content = (value.model_dump_json(indent=2) + "\n").encode()
        if len(content) > self._max_bytes:
            raise ConfigError(
                f"{self.path}: would have {len(content)} bytes, and at most {self._max_bytes} are read; "
                "it stays as it was"
            )
        try:
            self._model.model_validate_json(content)
        except ValidationError as error:
            mistakes = summarize_validation_error(error)
            raise ConfigError(
                f"{self.path}: could not be read again; it stays as it was; {mistakes}"
            ) from error
        write_atomically(self.path, content)

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
            reason = system_reason(error)
            raise ConfigError(f"{self.path}: cannot be erased ({reason})") from error
        return True
