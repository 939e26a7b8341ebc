"""Where recordings lie, and the index beside them."""

import codecs
import math
import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from pointit.evaluation.recordings.table_file import check_file, check_text, is_file, shown_path, truncate
from pointit.runtime.errors import ConfigError
from pointit.schemas import summarize_validation_error

VARIABLE = "POINTIT_DATA"
"""Names the folder with the recordings where no option does."""

RECORDINGS = "recordings"
"""Folder in the data's root that holds one folder a set."""

INDEX = "index.json"
"""What is known about the files beside it: a list of objects with `file`, or an object with such `files`."""

MAX_INDEX_BYTES = 10_000_000
"""Of an index: hundred thousands of files."""

EYE_HEIGHTS_M = (0.3, 3.0)
"""Over the floor, of anybody, seated or a child."""

MOST_YAW_DEG = 720.0
"""Either way: some write an angle unwrapped, nobody by more than two turns."""

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
    try:
        if not data.is_dir():
            raise ConfigError(f"{data}: is no folder; give --data DIR with the recordings")
        inner = data / RECORDINGS
        return inner if inner.is_dir() else data
    except (OSError, ValueError) as error:
        what = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(
            f"{shown_path(data)}: cannot be looked at ({what}); give --data DIR with the recordings"
        ) from error


def read_index(folder: Path) -> list[Entry]:
    """Return what the index of `folder` says, an object a file.

    Raises:
        ConfigError: it cannot be read, is no index, or lists a file twice.
    """
    path = folder / INDEX
    check_file(path, MAX_INDEX_BYTES)
    try:
        raw = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    try:
        if raw.lstrip()[:1] == b"{":
            entries = _ENTRIES.validate_python(_WRAPPED.validate_json(raw).get("files"))
        else:
            entries = _ENTRIES.validate_json(raw)
    except ValidationError as error:
        raise ConfigError(
            f"{path}: a list of objects, one a file, was expected; {summarize_validation_error(error)}"
        ) from error
    except ValueError as error:  # of numbers with thousands of digits
        raise ConfigError(f"{path}: a value in it cannot be shown ({error}); correct the index") from error
    names = [name for entry in entries if isinstance(name := entry.get("file"), str)]
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice is not None:
        raise ConfigError(f"{path}, 'file': {truncate(twice)} is listed twice; list each file once")
    return list(entries)


def text_of(folder: Path, entry: Entry, key: str) -> str:
    """Return a text that an `entry` must have.

    Raises:
        ConfigError: it is not there, is empty, too long or does not print.
    """
    value = entry.get(key)
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) < 10**15:
        value = str(value)  # a subject may be a number
    if not isinstance(value, str):
        raise ConfigError(f"{_where(folder, entry, key)}: a text was expected, got {truncate(value)}")
    return check_text(_where(folder, entry, key), value)


def file_of(folder: Path, entry: Entry) -> Path | None:
    """Return the file of an `entry`; none where it is not there.

    Raises:
        ConfigError: the name is no text, leads out of `folder`, or names something other than a file.
    """
    name = text_of(folder, entry, "file")
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise ConfigError(
            f"{folder / INDEX}, 'file': {truncate(name)} leads out of the folder; name a file in {folder}"
        )
    path = folder / name
    return path if is_file(path) else None


def number_of(folder: Path, entry: Entry, key: str, bounds: tuple[float, float], unit: str) -> float | None:
    """Return a number of an `entry`, or none where it is not given.

    Raises:
        ConfigError: it is something else, or not within the `bounds`, in `unit`.
    """
    least, most = bounds
    value = entry.get(key)
    if value is None:
        return None
    # compared before it is converted: an integer may be beyond any float
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise ConfigError(
            f"{_where(folder, entry, key)}: a number from {least:g} to {most:g} {unit} was expected, "
            f"got {truncate(value)}"
        )
    return float(value)


def yaw_of(folder: Path, entry: Entry) -> float | None:
    """Return the yaw of {H} in {W}, rad: less the azimuth in {H} minus that in {W} which the index has.

    Raises:
        ConfigError: it is no number, or more than two turns.
    """
    degrees = number_of(
        folder, entry, "ref_yaw_deg_human_minus_world", (-MOST_YAW_DEG, MOST_YAW_DEG), "degrees"
    )
    return None if degrees is None else math.remainder(-math.radians(degrees), math.tau)


def eye_height_of(folder: Path, entry: Entry) -> float | None:
    """Return the height of the eyes over the floor, m, or none where it is not given.

    Raises:
        ConfigError: it is no number, or nobody's.
    """
    return number_of(folder, entry, "eye_height_guess_m", EYE_HEIGHTS_M, "metres")


def _where(folder: Path, entry: Entry, key: str) -> str:
    name = entry.get("file", "an entry")
    named = name if isinstance(name, str) and name.isprintable() and len(name) <= 60 else truncate(name)
    return f"{folder / INDEX}, {named}, {key!r}"
