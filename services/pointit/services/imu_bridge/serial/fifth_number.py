"""Number beside the four of a quaternion: on which side it stands, and its meaning."""

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
"""Largest number in front of a quaternion that may be that of a sensor although it never was read before."""
MEMORY = 64
"""Number of lines over which numbers in front are compared."""
MAX_RISES = 16
"""Number of lines over which numbers of sensors rise by one each before they return, or one is repeated."""
MAX_JUMPS = 4
"""The same if they rise by more than one each."""
MAX_OPEN = 16
"""Number of lines that are passed over while both halves may be the quaternion: a clock starts at 0."""
MEMORY_BEHIND = 16
"""Number of lines in which numbers behind the quaternion come round and round if they are of sensors."""


class LeadingNumber:
    """Tells whether the number in front of the quaternions of one stream is that of a sensor or a time."""

    def __init__(self) -> None:
        self._newest: deque[float] = deque(maxlen=MEMORY)
        self._returns = self._rises = self._jumps = 0
        self._is_sensor: bool | None = None

    def is_sensor(self, number: float) -> bool | None:
        """Return True for the number of a sensor, False for a time, None while it may be either.

        Whole numbers that return to earlier ones are those of sensors, also if they were taken for a time;
        others that rise, are not whole or exceed `MAX_SENSOR` are times.
        """
        before = self._newest[-1] if self._newest else number
        count, is_whole = self._newest.count(number), math.isfinite(number) and number == round(number)
        self._newest.append(number)
        if self._is_sensor and is_whole:
            return True
        self._returns += is_whole and number < before and count > 0
        self._rises += number > before
        self._jumps += number > before + 1
        is_beyond = not (is_whole and 0 <= number <= MAX_SENSOR)
        # a clock that is started again may return once
        if self._returns > (self._is_sensor is False) or (count >= MAX_RISES and not self._rises):
            self._is_sensor = is_whole
        elif is_beyond or self._rises >= MAX_RISES or self._jumps >= MAX_JUMPS:
            self._is_sensor = False
        return self._is_sensor


class TrailingNumber:
    """Tells whether the number behind the quaternions of one stream is that of a sensor."""

    def __init__(self) -> None:
        self._newest: deque[float] = deque(maxlen=MEMORY_BEHIND)
        self._is_sensor = False

    def is_sensor(self, number: float) -> bool:
        """Return True for the number of a sensor, which comes round and round, False for an accuracy."""
        newest = self._newest
        newest.append(number)
        period = len(set(newest))
        self._is_sensor = self._is_sensor or (
            len(newest) == MEMORY_BEHIND
            and 1 < period <= MEMORY_BEHIND // 2
            and all(math.isfinite(each) and each == round(each) for each in newest)
            and all(newest[at] == newest[at - period] for at in range(period, MEMORY_BEHIND))
        )
        return self._is_sensor


class FifthNumber:
    """Separates the fifth number of the lines of one stream, by the norms of both halves.

    A number in front is judged by `LeadingNumber`, one behind by `TrailingNumber`.
    """

    def __init__(self, fifth: Fifth = "auto") -> None:
        self._fifth: Fifth = fifth
        self._is_behind: bool | None = None
        """Side in the newest line in which the norms told it."""
        self._first = 0.0
        """First number of the newest line in which they did not."""
        self._open = 0
        """Number of such lines."""
        self._leading = LeadingNumber()
        self._trailing = TrailingNumber()

    def split(self, numbers: Sequence[float]) -> tuple[Sequence[float], str, float | None] | None:
        """Return the quaternion's four numbers, the sensor's number or `""`, and the time, µs, or None.

        None for the first lines in which its side or meaning is open.

        Raises:
            ValueError: If the side stays open.
        """
        is_behind = self._side(numbers)
        if is_behind is None:
            return None
        four, beside = (numbers[:4], numbers[4]) if is_behind else (numbers[1:], numbers[0])
        if self._fifth == "auto":
            is_sensor = (self._trailing if is_behind else self._leading).is_sensor(beside)
        else:
            is_sensor = self._fifth == "sensor"
        if is_sensor is None:
            return None
        return four, f"{beside:.9g}" if is_sensor else "", None if is_sensor or is_behind else beside

    def _side(self, numbers: Sequence[float]) -> bool | None:
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
            before, self._first = self._first, numbers[0]
            is_falling = self._first < before and not self._first.is_integer()
            is_no_front, is_no_accuracy = self._first < 0 or is_falling, numbers[4] < 0
            if is_no_front != is_no_accuracy:
                self._is_behind = is_no_front
                return is_no_front
            self._open += 1
            if self._open <= MAX_OPEN:
                return None
            raise ValueError(
                "has five numbers, of which the first and the last four are a quaternion: set the parameter "
                "`fifth` to time, sensor or accuracy"
            )
        return bool(self._is_behind)


def is_unit(four: Sequence[float], tolerance: float = NORM_TOLERANCE) -> bool:
    """Return True if `four` numbers may be a quaternion."""
    return abs(math.hypot(*four) - 1.0) <= tolerance
