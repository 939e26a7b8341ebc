"""`synth_two_led`: simulated people point at two lamps, three seconds at each."""

import math
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from pointit.runtime.errors import ConfigError
from pointit.services.localizer.estimation.estimator import Pointings
from pointit_lab.evaluation.datasets.plausible import check_reach, check_times
from pointit_lab.evaluation.localization.trial import Array, LocalizationTrial, TrialReading
from pointit_lab.evaluation.recordings.data_folder import EYE_HEIGHTS_M, MAX_YAW_DEG
from pointit_lab.evaluation.recordings.table_file import (
    FARTHEST,
    MAX_CHARACTERS,
    check_file,
    check_text,
    is_file,
    truncate,
)

NAME = "synth_two_led"

FILE = "trials.npz"

SUBJECT = "simulated"

MAX_TRIALS = 100_000
"""Limit of trials; more need hours."""

PAUSE_S = 2.0
"""Pause inserted between the lamps if the file has none: while the arm moves, it does not point."""

_NUMBERS = (
    "ray_az_rad", "ray_el_rad", "led_xyz", "led_of_sample", "t_s", "eye_height_m",
    "truth_user_xy", "truth_yaw_rad", "scenario",
)  # fmt: skip

Kind = Literal["number", "text"]

MAX_VALUES = 10_000_000
"""Limit of the values in all arrays together, which bounds the memory of an evaluation."""

_DTYPES: dict[Kind, str] = {"number": "iuf", "text": "U"}


def read(folder: Path, reading: TrialReading) -> None:
    """Add all trials; the condition is the name of the scenario.

    Raises:
        ConfigError: If the file is damaged.
    """
    path = folder / FILE
    if not is_file(path):
        reading.skip(path, "it is missing")
        return
    data, names = _load(path)
    azimuths, elevations = data["ray_az_rad"], data["ray_el_rad"]
    level = np.cos(elevations)
    directions = np.stack([level * np.cos(azimuths), level * np.sin(azimuths), np.sin(elevations)], axis=2)
    lamps = data["led_of_sample"].astype(np.int64)
    eyes_m = float(data["eye_height_m"])
    origins_m = np.tile([0.0, 0.0, eyes_m], (len(lamps), 1))
    stamps_s = _with_pauses(data["t_s"], lamps)
    for i in range(len(azimuths)):
        reading.trials.append(
            LocalizationTrial(
                set=NAME,
                subject=SUBJECT,
                condition=names[int(data["scenario"][i])],
                pointings=Pointings(stamps_s, origins_m, directions[i], data["led_xyz"][lamps]),
                eye_height_m=eyes_m,
                x_m=float(data["truth_user_xy"][i, 0]),
                y_m=float(data["truth_user_xy"][i, 1]),
                # the file has azimuth in {H} = azimuth in {W} + yaw, the opposite sign of ours
                yaw_rad=-float(data["truth_yaw_rad"][i]),
            )
        )


def _with_pauses(times_s: Array, lamps: NDArray[np.int64]) -> Array:
    """Return `times_s`, shifted by `PAUSE_S` after each change of the lamp."""
    return times_s + PAUSE_S * np.append(0, np.cumsum(np.diff(lamps) != 0))


def _load(path: Path) -> tuple[dict[str, Array], list[str]]:
    kinds: dict[str, Kind] = dict.fromkeys(_NUMBERS, "number")
    arrays = read_arrays(path, {**kinds, "scenario_names": "text"})
    texts = arrays.pop("scenario_names")
    if texts.ndim != 1 or not len(texts):
        raise ConfigError(
            f"{path}, array 'scenario_names': a row of names was expected, got the shape {texts.shape}"
        )
    names = [check_text(f"{path}, array 'scenario_names'", str(name)) for name in texts.tolist()]
    if len(set(names)) < len(names):
        raise ConfigError(f"{path}, array 'scenario_names': contains a name twice; give each its own")
    _check_shapes(path, arrays)
    with np.errstate(over="ignore"):  # of long doubles: infinity exceeds every bound
        data = {name: values.astype(np.float64) for name, values in arrays.items()}
    _check_values(path, data, names)
    return data, names


def _check_shapes(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    shape = arrays["ray_az_rad"].shape
    if len(shape) != 2 or not 0 < shape[0] <= MAX_TRIALS or shape[1] < 2:
        raise ConfigError(
            f"{path}, array 'ray_az_rad': 1 to {MAX_TRIALS} trials of at least 2 samples each were expected, "
            f"got the shape {shape}"
        )
    n, samples = shape
    lamps = arrays["led_xyz"].shape[0] if arrays["led_xyz"].ndim == 2 else 2
    wanted: dict[str, tuple[int, ...]] = {
        "ray_az_rad": (n, samples),
        "ray_el_rad": (n, samples),
        "led_xyz": (lamps, 3),
        "led_of_sample": (samples,),
        "t_s": (samples,),
        "eye_height_m": (),
        "truth_user_xy": (n, 2),
        "truth_yaw_rad": (n,),
        "scenario": (n,),
    }
    for name, values in arrays.items():
        if values.shape != wanted[name]:
            raise ConfigError(
                f"{path}, array {name!r}: the shape {wanted[name]} was expected beside {n} trials of "
                f"{samples} samples, got {values.shape}"
            )


def _check_values(path: Path, data: Mapping[str, Array], names: Sequence[str]) -> None:
    turns_rad = math.radians(MAX_YAW_DEG)
    bounds: dict[str, tuple[float, float, str]] = {
        "ray_az_rad": (-turns_rad, turns_rad, "radians"),
        "ray_el_rad": (-math.pi / 2.0 - 1e-6, math.pi / 2.0 + 1e-6, "radians"),
        "truth_yaw_rad": (-turns_rad, turns_rad, "radians"),
        "eye_height_m": (*EYE_HEIGHTS_M, "metres"),
        "led_xyz": (-FARTHEST, FARTHEST, "metres"),
        "truth_user_xy": (-FARTHEST, FARTHEST, "metres"),
        "led_of_sample": (0, len(data["led_xyz"]) - 1, "that count the lamps"),
        "scenario": (0, len(names) - 1, "that count 'scenario_names'"),
    }
    for name, (least, max_bytes, unit) in bounds.items():
        values = data[name].reshape(-1)
        counts = unit.startswith("that")
        wrong = (values < least) | (values > max_bytes) | (counts & (values != np.floor(values)))
        if np.any(wrong):
            raise ConfigError(
                f"{path}, array {name!r}: numbers from {least:.4g} to {max_bytes:.4g} {unit} were expected, "
                f"got {values[wrong][0]:g}"
            )
    check_times(path, data["t_s"], "array 't_s'")
    for lamp in data["led_xyz"][np.unique(data["led_of_sample"]).astype(np.int64)]:
        people_m = np.column_stack([data["truth_user_xy"], np.zeros(len(data["truth_user_xy"]))])
        check_reach(path, lamp, people_m, "a lamp of 'led_xyz' and a person of 'truth_user_xy'")


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
            f"{path}: not a readable file of arrays ({_error_text(error)}); save it with numpy.savez"
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
                f"{path}, array {name!r}: is damaged ({_error_text(error)}); save the file again"
            ) from error
        left -= arrays[name].size
    return arrays


def _array(
    where: str, file: zipfile.ZipFile, info: zipfile.ZipInfo, kind: Kind, max_bytes: int
) -> NDArray[Any]:
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
        if min(shape, default=0) < 0 or count > max_bytes:
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


def _error_text(error: Exception) -> str:
    """Return the first line of `error`, shortened, since it may be long or empty."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else f"{text[:117]}..."
