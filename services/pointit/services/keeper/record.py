"""What a restarted keeper finds on disk: one file, written whole or not at all."""

from pathlib import Path
from typing import ClassVar

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.atomic_file import write_atomically
from pointit.schemas import DecodeError, SchemaModel, decode, encode
from pointit.schemas.base import Many, Ns

FILE = "states.msgpack"


class KeptState(SchemaModel):
    """One state as it travels."""

    key: str
    """Of its row."""
    name: str
    schema_name: str
    payload: bytes


class Record(SchemaModel):
    """All that is kept."""

    max_bytes: ClassVar[int] = 80 * 1024 * 1024
    """Above what a keeper may be told to keep."""

    stamp_ns: Ns
    states: Many[KeptState] = ()


def read(path: Path) -> Record | None:
    """Return what is in the file at `path`, or none.

    Raises:
        ConfigError: there is something, but it cannot be read or used; names the file.
    """
    try:
        with path.open("rb") as file:
            return decode(Record, file.read(Record.max_bytes + 1))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    except DecodeError as error:
        raise ConfigError(f"{path}: cannot be used, and is written anew ({error})") from error


def write(path: Path, record: Record) -> None:
    """Write `record` in place of what is there, readable by its owner alone.

    Raises:
        ConfigError: it cannot be written; names the file.
    """
    write_atomically(path, encode(record))
