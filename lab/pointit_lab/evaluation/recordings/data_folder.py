"""The folder of recordings, and its index files."""

import codecs
import math
import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from pointit.runtime.errors import ConfigError
from pointit.schemas import summarize_validation_error
from pointit.schemas.printable import is_printable
from pointit.schemas.text import system_reason
from pointit_lab.evaluation.recordings.table_file import check_file, check_text, is_file, shown_path, truncate

Entry = Mapping[str, Any]

VARIABLE = "POINTIT_DATA"
"""Environment variable with the folder of recordings, if there is no option."""

RECORDINGS = "recordings"
"""Subfolder of the data's root with one folder per set."""

INDEX = "index.json"
"""Metadata of the files beside it: a list of objects with `file`, or an object with such `files`."""

MAX_INDEX_BYTES = 10_000_000
"""Limit of an index, enough for hundreds of thousands of files."""

EYE_HEIGHTS_M = (0.3, 3.0)
"""Range over the floor, including seated people and children."""

MAX_YAW_DEG = 720.0
"""Limit of the absolute value: some recordings have unwrapped angles, but at most two turns."""
_ENTRIES = TypeAdapter(list[dict[str, Any]])
_WRAPPED = TypeAdapter(dict[str, Any])


def recordings_folder(data: Path | None) -> Path:
    """Return the folder with one folder per set.

    Args:
        data: that folder, or its parent with the subfolder `recordings`. None: `$POINTIT_DATA`.

    Raises:
        ConfigError: If it is not given, or not a folder.
    """
    if data is None:
        folder = os.environ.get(VARIABLE, "")
        if not folder:
            raise ConfigError(f"there is nothing to evaluate: give --data DIR or set {VARIABLE}")
        data = Path(folder)
    try:
        if not data.is_dir():
            raise ConfigError(f"{data}: not a folder; give --data DIR with the recordings")
        inner = data / RECORDINGS
        return inner if inner.is_dir() else data
    except (OSError, ValueError) as error:
        reason = system_reason(error)
        problem = f"cannot be accessed ({reason})"
        raise ConfigError(f"{shown_path(data)}: {problem}; give --data DIR with the recordings") from error


def read_index(folder: Path) -> list[Entry]:
    """Return the entries of the index of `folder`, one per file.

    Raises:
        ConfigError: If it cannot be read, is not an index, or lists a file twice.
    """
    path = folder / INDEX
    check_file(path, MAX_INDEX_BYTES)
    try:
        raw = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    except OSError as error:
        reason = system_reason(error)
        raise ConfigError(f"{path}: cannot be read ({reason})") from error

    # a list, or an object with such a list
    try:
        if raw.lstrip()[:1] == b"{":
            files = _WRAPPED.validate_json(raw).get("files")
            entries = _ENTRIES.validate_python(files)
        else:
            entries = _ENTRIES.validate_json(raw)
    except ValidationError as error:
        problem = summarize_validation_error(error)
        raise ConfigError(f"{path}: a list of objects, one a file, was expected; {problem}") from error
    except ValueError as error:  # numbers with thousands of digits
        raise ConfigError(f"{path}: a value in it cannot be shown ({error}); correct the index") from error

    # names of other types are refused when the file is read
    counts: Counter[str] = Counter()
    for entry in entries:
        name = entry.get("file")
        if isinstance(name, str):
            counts[name] += 1
    for name, count in counts.items():
        if count > 1:
            raise ConfigError(f"{path}, 'file': {truncate(name)} is listed twice; list each file once")
    return list(entries)


def text_of(folder: Path, entry: Entry, key: str) -> str:
    """Return a required text of an `entry`.

    Raises:
        ConfigError: If it is missing, empty, too long or not printable.
    """
    value = entry.get(key)
    where = _where(folder, entry, key)
    # a subject may be a number; Python does not format one of thousands of digits
    is_integer = isinstance(value, int) and not isinstance(value, bool)
    if is_integer and abs(value) < 10**15:
        value = str(value)
    if not isinstance(value, str):
        raise ConfigError(f"{where}: a text was expected, got {truncate(value)}")
    return check_text(where, value)


def file_of(folder: Path, entry: Entry) -> Path | None:
    """Return the file of an `entry`, or None if it is missing.

    Raises:
        ConfigError: If the name is not a text, leads out of `folder`, or is not that of a file.
    """
    name = text_of(folder, entry, "file")
    leads_out = Path(name).is_absolute() or ".." in Path(name).parts
    if leads_out:
        problem = f"{truncate(name)} leads out of the folder"
        raise ConfigError(f"{folder / INDEX}, 'file': {problem}; name a file in {folder}")
    path = folder / name
    return path if is_file(path) else None


def number_of(folder: Path, entry: Entry, key: str, bounds: tuple[float, float], unit: str) -> float | None:
    """Return a number of an `entry`, or None if it is not given.

    Raises:
        ConfigError: If it is not a number within the `bounds`, in `unit`.
    """
    lower, upper = bounds
    value = entry.get(key)
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    # compared before it is converted: an integer may be beyond any float
    if not is_number or not lower <= value <= upper:
        expected = f"a number from {lower:g} to {upper:g} {unit} was expected"
        raise ConfigError(f"{_where(folder, entry, key)}: {expected}, got {truncate(value)}")
    return float(value)


def yaw_of(folder: Path, entry: Entry) -> float | None:
    """Return the yaw of {H} in {W}, rad. The index has its negative: azimuth in {H} minus that in {W}.

    Raises:
        ConfigError: If it is not a number, or more than two turns.
    """
    bounds = (-MAX_YAW_DEG, MAX_YAW_DEG)
    degrees = number_of(folder, entry, "ref_yaw_deg_human_minus_world", bounds, "degrees")
    if degrees is None:
        return None
    return math.remainder(-math.radians(degrees), math.tau)


def eye_height_of(folder: Path, entry: Entry) -> float | None:
    """Return the height of the eyes over the floor, m, or None if it is not given.

    Raises:
        ConfigError: If it is not a number, or outside `EYE_HEIGHTS_M`.
    """
    return number_of(folder, entry, "eye_height_guess_m", EYE_HEIGHTS_M, "metres")


def _where(folder: Path, entry: Entry, key: str) -> str:
    name = entry.get("file", "an entry")
    label = truncate(name)
    # a plain name needs no quotes
    if isinstance(name, str) and is_printable(name):
        label = name if len(name) <= 60 else label
    return f"{folder / INDEX}, {label}, {key!r}"
