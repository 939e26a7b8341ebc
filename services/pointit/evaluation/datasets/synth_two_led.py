"""`synth_two_led`: simulated people point at two lamps, three seconds at each."""

import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit.evaluation.trial import Array, Reading, Trial
from pointit.runtime.errors import ConfigError
from pointit.services.localizer.estimator import Pointings

NAME = "synth_two_led"
FILE = "trials.npz"
SUBJECT = "simulated"

MAX_VALUES = 50_000_000
"""More does not fit the memory that an evaluation should take."""

PAUSE_S = 2.0
"""Put between the lamps where the times of the file have none: the arm moves, and that is not pointing."""

_NUMBERS = (
    "ray_az_rad", "ray_el_rad", "led_xyz", "led_of_sample", "t_s", "eye_height_m",
    "truth_user_xy", "truth_yaw_rad", "scenario",
)  # fmt: skip


def read(folder: Path, reading: Reading) -> None:
    """Add all trials; the condition is the name of the scenario.

    Raises:
        ConfigError: the file is damaged.
    """
    path = folder / FILE
    if not path.exists():
        reading.skip(path, "it is not there")
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
            Trial(
                set=NAME,
                subject=SUBJECT,
                condition=str(names[int(data["scenario"][i])]),
                pointings=Pointings(stamps_s, origins_m, directions[i], data["led_xyz"][lamps]),
                eye_height_m=eyes_m,
                x_m=float(data["truth_user_xy"][i, 0]),
                y_m=float(data["truth_user_xy"][i, 1]),
                # the file has azimuth in {H} = azimuth in {W} + yaw, which is the other way round
                yaw_rad=-float(data["truth_yaw_rad"][i]),
                independent_hz=None,  # errors are white in one scenario, constant over a hold in others
            )
        )


def _with_pauses(times_s: Array, lamps: NDArray[np.int64]) -> Array:
    """Return `times_s`, later by `PAUSE_S` after each change of the lamp."""
    return times_s + PAUSE_S * np.append(0, np.cumsum(np.diff(lamps) != 0))


def _load(path: Path) -> tuple[dict[str, Array], list[str]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            missing = [name for name in (*_NUMBERS, "scenario_names") if name not in file]
            if missing:
                raise ConfigError(f"{path}: array {missing[0]!r} is missing")
            data = {name: np.asarray(file[name], dtype=np.float64) for name in _NUMBERS}
            names = [str(name) for name in np.asarray(file["scenario_names"]).reshape(-1)]
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigError(f"{path}: is no readable file of arrays ({error})") from error
    _check(path, data, names)
    return data, names


def _check(path: Path, data: dict[str, Array], names: list[str]) -> None:
    shape = data["ray_az_rad"].shape
    n, samples = shape if len(shape) == 2 else (0, 0)
    lamps = data["led_xyz"].shape[0] if data["led_xyz"].ndim == 2 else 0
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
    for name, values in data.items():
        if values.shape != wanted[name] or not np.all(np.isfinite(values)) or values.size > MAX_VALUES:
            raise ConfigError(
                f"{path}, array {name!r}: finite numbers of shape {wanted[name]} were expected, "
                f"got shape {values.shape}"
            )
    for name, most in (("led_of_sample", lamps), ("scenario", len(names))):
        if np.any((data[name] < 0) | (data[name] >= most)):
            raise ConfigError(f"{path}, array {name!r}: numbers from 0 to {most - 1} were expected")
