"""Files of named arrays (`.npz`), unpacked only after their headers were checked."""

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.recordings.table_file import MAX_CHARACTERS, check_file, truncate

Kind = Literal["number", "text"]

MAX_VALUES = 10_000_000
"""Limit of the values in all arrays together, which bounds the memory of an evaluation."""

_DTYPES: dict[Kind, str] = {"number": "iuf", "text": "U"}


def read_arrays(path: Path, kinds: Mapping[str, Kind]) -> dict[str, NDArray[Any]]:
    """Return the arrays `kinds` of the file at `path` as stored; others are ignored.

    Raises:
        ConfigError: If it is not such a file, an array is missing, damaged, too large or of another kind, or
        a number is not finite.
    """
    check_file(path)
    try:
        with zipfile.ZipFile(path) as file:
            return _arrays(path, file, kinds)
    except ConfigError:
        raise
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    except Exception as error:  # zipfile, zlib and numpy raise a dozen kinds on damaged bytes
        raise ConfigError(
            f"{path}: not a readable file of arrays ({_told(error)}); save it with numpy.savez"
        ) from error


def _arrays(path: Path, file: zipfile.ZipFile, kinds: Mapping[str, Kind]) -> dict[str, NDArray[Any]]:
    members = {info.filename: info for info in file.infolist()}
    arrays: dict[str, NDArray[Any]] = {}
    left = MAX_VALUES
    for name, kind in kinds.items():
        info = members.get(f"{name}.npy")
        if info is None:
            raise ConfigError(f"{path}: array {name!r} is missing; save it with the others")
        try:
            arrays[name] = _array(f"{path}, array {name!r}", file, info, kind, left)
        except ConfigError:
            raise
        except Exception as error:  # as above
            raise ConfigError(
                f"{path}, array {name!r}: is damaged ({_told(error)}); save the file again"
            ) from error
        left -= arrays[name].size
    return arrays


def _array(where: str, file: zipfile.ZipFile, info: zipfile.ZipInfo, kind: Kind, most: int) -> NDArray[Any]:
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ConfigError(f"{where}: unsupported compression; save it with numpy.savez")
    with file.open(info) as stream:
        read_header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(
            npy.read_magic(stream)
        )
        if read_header is None:
            raise ConfigError(f"{where}: unsupported version of the format; save it with numpy.savez")
        shape, is_fortran, dtype = read_header(stream)
        if dtype.kind not in _DTYPES[kind] or (kind == "text" and dtype.itemsize > 4 * MAX_CHARACTERS):
            wanted = "real numbers" if kind == "number" else f"texts of at most {MAX_CHARACTERS} characters"
            raise ConfigError(f"{where}: {wanted} were expected, got {truncate(str(dtype))}; convert them")
        count = math.prod(shape)
        if min(shape, default=0) < 0 or count > most:
            raise ConfigError(
                f"{where}: has the shape {truncate(shape)} and at most {MAX_VALUES:g} values are read "
                "from one file; cut it into pieces"
            )
        size = count * dtype.itemsize
        raw = stream.read(size + 1)  # up to the end, where the checksum is verified
    if len(raw) != size:
        less = "less" if len(raw) < size else "more"
        raise ConfigError(f"{where}: {size} bytes were expected, and there are {less}; save the file again")
    values: NDArray[Any] = np.frombuffer(raw, dtype).reshape(shape, order="F" if is_fortran else "C")
    if kind == "number" and not np.all(np.isfinite(values)):
        at = [int(i) for i in np.argwhere(~np.isfinite(values))[0]]
        raise ConfigError(
            f"{where}: finite numbers were expected, got {values[tuple(at)]} at {at}; correct it"
        )
    return values


def _told(error: Exception) -> str:
    """Return the first line of `error`, shortened, since it may be long or empty."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else f"{text[:117]}..."
