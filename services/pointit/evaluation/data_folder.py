"""Where recordings lie, and the index beside them."""

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from pointit.runtime.errors import ConfigError
from pointit.schemas import explain

VARIABLE = "POINTIT_DATA"
"""Names the folder with the recordings where no option does."""

RECORDINGS = "recordings"
"""Folder in the data's root that holds one folder a set."""

INDEX = "index.json"
"""What is known about the files beside it: a list of objects with `file`, or an object with such `files`."""

Entry = Mapping[str, Any]

_ENTRIES = TypeAdapter(list[dict[str, Any]])
_WRAPPED = TypeAdapter(dict[str, Any])


def recordings_folder(data: Path | None) -> Path:
    """Return the folder that holds one folder a set.

    Args:
        data: that folder, or the one that has it as `recordings`; none: as `$POINTIT_DATA` says.

    Raises:
        ConfigError: it is not told, or is no folder.
    """
    if data is None:
        told = os.environ.get(VARIABLE, "")
        if not told:
            raise ConfigError(f"there is nothing to evaluate: give --data DIR or set {VARIABLE}")
        data = Path(told)
    if not data.is_dir():
        raise ConfigError(f"{data}: is no folder; give --data DIR with the recordings")
    inner = data / RECORDINGS
    return inner if inner.is_dir() else data


def read_index(folder: Path) -> list[Entry]:
    """Return what the index of `folder` says, an object a file.

    Raises:
        ConfigError: it cannot be read or is no index.
    """
    path = folder / INDEX
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    try:
        if raw.lstrip()[:1] == b"{":
            return list(_ENTRIES.validate_python(_WRAPPED.validate_json(raw).get("files")))
        return list(_ENTRIES.validate_json(raw))
    except ValidationError as error:
        raise ConfigError(f"{path}: a list of objects, one a file, was expected; {explain(error)}") from error


def text_of(folder: Path, entry: Entry, key: str) -> str:
    """Return a text that an `entry` must have.

    Raises:
        ConfigError: it is not there or empty.
    """
    value = entry.get(key)
    if isinstance(value, int) and not isinstance(value, bool):  # a subject may be a number
        value = str(value)
    if not isinstance(value, str) or not value:
        raise ConfigError(
            f"{folder / INDEX}, {entry.get('file', 'an entry')}, {key!r}: a text was expected, got {value!r}"
        )
    return value


def number_of(folder: Path, entry: Entry, key: str) -> float | None:
    """Return a number of an `entry`, or none where it is not given.

    Raises:
        ConfigError: it is something else.
    """
    value = entry.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigError(
            f"{folder / INDEX}, {entry.get('file', 'an entry')}, {key!r}: a number was expected, "
            f"got {value!r}"
        )
    return float(value)


def yaw_of(folder: Path, entry: Entry) -> float | None:
    """Return the yaw of {H} in {W}, rad: less the azimuth in {H} minus that in {W} which the index has."""
    degrees = number_of(folder, entry, "ref_yaw_deg_human_minus_world")
    return None if degrees is None else math.remainder(-math.radians(degrees), math.tau)
