"""File of a keeper's states on disk, written atomically."""

from pathlib import Path
from typing import ClassVar

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.atomic_file import read_limited, write_atomically
from pointit.schemas import DecodeError, SchemaModel, decode, encode
from pointit.schemas.base import Many, Ns

FILE = "states.msgpack"


class StoredState(SchemaModel):
    """One encoded state."""

    key: str
    """Key of its topic."""
    name: str
    schema_name: str
    payload: bytes


class StateRecord(SchemaModel):
    """All stored states."""

    max_bytes: ClassVar[int] = 80 * 1024 * 1024
    """More than the largest `max_mb`."""

    stamp_ns: Ns
    states: Many[StoredState] = ()


def read(path: Path) -> StateRecord | None:
    """Return the record in the file at `path`, or None if there is no file.

    Raises:
        ConfigError: If there is a file but it cannot be read or used; names the file.
    """
    try:
        return decode(StateRecord, read_limited(path, StateRecord.max_bytes + 1))
    except FileNotFoundError:
        return None
    except DecodeError as error:
        raise ConfigError(f"{path}: cannot be used and will be overwritten ({error})") from error


def write(path: Path, record: StateRecord) -> None:
    """Replace the file by `record`, readable by its owner only.

    Raises:
        ConfigError: If it cannot be written; names the file.
    """
    write_atomically(path, encode(record))
