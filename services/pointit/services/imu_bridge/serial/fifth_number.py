"""Number beside the four of a quaternion in a line of text: on which side it stands, and its meaning."""

import math
from collections import deque
from collections.abc import Sequence
from typing import Literal

from pointit.schemas.base import NORM_TOLERANCE

Fifth = Literal["auto", "time", "accuracy", "sensor"]
"""Meaning of a fifth number in a line."""
ROUNDING_TOLERANCE = 0.011
"""Largest deviation of the norm of a unit quaternion whose numbers have two decimals, with a margin."""
MAX_SENSOR = 255
"""Largest number of a sensor in front of a quaternion; a larger one is the device's time in µs."""
MEMORY = 16
"""Number of lines over which fifth numbers are compared."""
MIN_RETURNS = 4
"""Number of returns of a number behind the quaternion within `MEMORY` lines if several sensors send."""


class FifthNumber:
    """Separates the fifth number of the lines of one stream, by the norms of both halves.

    In front it is the number of a sensor if it is whole and at most `MAX_SENSOR`, or returns to earlier
    values; else a time. Behind it is an accuracy unless it returns to earlier values again and again.
    """

    def __init__(self, fifth: Fifth = "auto") -> None:
        self._fifth: Fifth = fifth
        self._is_behind: bool | None = None
        """Side in the newest line in which the norms told it."""
        self._is_sensor = fifth == "sensor"
        """True if it is the number of a sensor, whatever its size."""
        self._newest: deque[float] = deque(maxlen=MEMORY)

    def split(self, numbers: Sequence[float]) -> tuple[Sequence[float], str, float | None]:
        """Return the quaternion's four numbers, the sensor's number or `""`, and the time, µs, or None.

        Raises:
            ValueError: If the norms do not tell the side.
        """
        is_behind = self._side(numbers)
        four, beside = (numbers[:4], numbers[4]) if is_behind else (numbers[1:], numbers[0])
        if self._fifth == "auto" and not self._is_sensor:
            self._newest.append(beside)
            self._is_sensor = _returns(self._newest) >= (MIN_RETURNS if is_behind else 1)
        is_small = self._fifth == "auto" and not is_behind and is_sensor_number(beside)
        if self._is_sensor or is_small:
            return four, f"{beside:.9g}", None
        return four, "", None if is_behind else beside

    def _side(self, numbers: Sequence[float]) -> bool:
        if self._fifth in ("time", "accuracy"):
            return self._fifth == "accuracy"
        fits_behind, fits_front = is_unit(numbers[:4]), is_unit(numbers[1:])
        if fits_behind != fits_front:
            self._is_behind = fits_behind
        elif fits_behind and self._is_behind is None and self._fifth == "auto":
            fits_behind, fits_front = (
                is_unit(four, ROUNDING_TOLERANCE) for four in (numbers[:4], numbers[1:])
            )
            if fits_behind != fits_front:
                return fits_behind
            raise ValueError(
                "has five numbers, of which the first and the last four are a quaternion: set the parameter "
                "`fifth` to time, sensor or accuracy"
            )
        return bool(self._is_behind)


def is_unit(four: Sequence[float], tolerance: float = NORM_TOLERANCE) -> bool:
    """Return True if `four` numbers may be a quaternion."""
    return abs(math.hypot(*four) - 1.0) <= tolerance


def is_sensor_number(number: float) -> bool:
    """Return True if a number in front of a quaternion is that of a sensor by itself."""
    return number == round(number) and 0 <= number <= MAX_SENSOR


def _returns(numbers: Sequence[float]) -> int:
    """Return the number of times that whole `numbers` fall back to an earlier one, as those of sensors do."""
    return sum(
        number < numbers[at - 1] and number in list(numbers)[: at - 1] and number == round(number)
        for at, number in enumerate(numbers)
        if at
    )
