"""Quaternions among other numbers of an OSC message, found by their norms over the messages of an address."""

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from typing import NamedTuple

from pointit.services.imu_bridge.network.datagram_source import DatagramError
from pointit.services.imu_bridge.serial.line_parser import (
    MAX_OPEN,
    ROUNDING_TOLERANCE,
    LeadingNumber,
    TrailingNumber,
    is_unit,
)

EXACT = 1e-3
"""Largest deviation of the norm of a quaternion that was normalized as floats."""
MAX_IDS = 2
"""Largest count of floats in front of a quaternion of which one may be the number of its sensor."""
MAX_MISFITS = 16
"""Number of messages in a row without a quaternion at the known position after which it is found again."""
FLOATS = frozenset("fds")
"""Types of numbers that are not whole, also in strings."""


class SensorQuaternion(NamedTuple):
    """Four numbers of a message, and the name of their sensor in it, or `""`."""

    four: Sequence[float]
    sensor: str = ""


class QuaternionPosition:
    """Position of the quaternions in messages of one address that have as many numbers."""

    def __init__(self, count: int, first: int) -> None:
        """Find the quaternions by their norms, or at `first`, from 1, if it is not 0."""
        self._first = first
        self._starts: AbstractSet[int] = frozenset()
        """Indices at which four numbers had norm 1 in each message, none before the first."""
        self._is_known = False
        self._misfits = self._open = 0
        self._leading = [LeadingNumber() for _ in range(count)]
        self._trailing = TrailingNumber()

    def quaternions(self, numbers: Sequence[float], types: str) -> list[SensorQuaternion]:
        """Return the quaternion of each sensor; `[]` for the first messages in which they are not known.

        `types` are those of the `numbers`.

        Raises:
            DatagramError: If there is none, or their position stays open.
        """
        if len(numbers) == 4:
            return [SensorQuaternion(numbers)]
        if self._first:
            if len(numbers) < self._first + 3:
                raise DatagramError(
                    f"has {len(numbers)} numbers, and osc.first is {self._first}: set it to the first of four"
                )
            return self._with_name(numbers, types, self._first - 1)
        if not self._is_known and not any(numbers[:4]):  # devices send zeros before their first quaternion
            return self._undecided("begins with four zeros: wait for its first quaternion, or set osc.first")
        starts = self._narrowed(
            len(numbers), {at for at in range(len(numbers) - 3) if is_unit(numbers[at : at + 4])}
        )
        if len(starts) > 1:
            exact = {at for at in starts if is_unit(numbers[at : at + 4], ROUNDING_TOLERANCE)}
            if groups := _groups(numbers, exact):
                return groups
            starts = _likeliest(numbers, types, starts)
        if len(starts) == 1:
            self._is_known = True
            return self._with_name(numbers, types, min(starts))
        places = " or ".join(f"{at + 1}" for at in sorted(starts))
        return self._undecided(
            f"has {len(numbers)} numbers, of which the quaternion may begin at {places}: set osc.first to "
            "one of these, or turn the device"
        )

    def _undecided(self, problem: str) -> list[SensorQuaternion]:
        """Return `[]` for the first messages.

        Raises:
            DatagramError: With `problem`, for the others.
        """
        self._open += 1
        if self._open > MAX_OPEN:
            raise DatagramError(problem)
        return []

    def _narrowed(self, count: int, fits: AbstractSet[int]) -> AbstractSet[int]:
        """Return those of the indices in `fits` that have fitted in all messages.

        Raises:
            DatagramError: If there is none.
        """
        starts = self._starts & fits if self._starts else fits
        if starts:
            self._starts, self._misfits = starts, 0
            return starts
        self._misfits += 1
        if self._misfits >= MAX_MISFITS:
            self._starts = fits
        raise DatagramError(
            f"has {count} numbers without a quaternion, whose norm is 1: let it send one, or set "
            "osc.address to the messages that have one"
        )

    def _with_name(self, numbers: Sequence[float], types: str, start: int) -> list[SensorQuaternion]:
        """Return the quaternion at `start` and the numbers of its sensor, `[]` while they may be counts."""
        ids = [at for at in range(start) if start <= MAX_IDS or types[at] not in FLOATS]  # no position
        are_sensors = [self._leading[at].is_sensor(numbers[at]) for at in ids]
        if None in are_sensors:
            return []
        names = [f"{numbers[at]:.9g}" for at, is_sensor in zip(ids, are_sensors, strict=True) if is_sensor]
        if len(numbers) == start + 5 and self._trailing.is_sensor(numbers[-1]):
            names.append(f"{numbers[-1]:.9g}")
        return [SensorQuaternion(numbers[start : start + 4], " ".join(names))]


def _likeliest(numbers: Sequence[float], types: str, starts: AbstractSet[int]) -> AbstractSet[int]:
    """Return those of `starts` without whole numbers, else those with an exact norm."""
    if not FLOATS.issuperset(types):
        starts = {at for at in starts if FLOATS.issuperset(types[at : at + 4])} or starts
    return {at for at in starts if is_unit(numbers[at : at + 4], EXACT)} or starts


def _groups(numbers: Sequence[float], starts: AbstractSet[int]) -> list[SensorQuaternion]:
    """Return the quaternions of several sensors, which fill the message, with their numbers or positions."""
    for begin, size in ((0, 4), (1, 5), (0, 5)):
        groups = [numbers[at : at + size] for at in range(0, len(numbers), size)]
        begins = set(range(begin, len(numbers), size))
        if len(groups) < 2 or len(numbers) % size or not begins <= starts or (size > 4 and begins != starts):
            continue
        besides = [group[0 if begin else 4] for group in groups] if size == 5 else []
        if any(each != round(each) for each in besides):
            continue  # accelerations and rates, perhaps
        has_numbers = begin > 0 and len({*besides}) == len(groups)
        return [
            SensorQuaternion(group[begin : begin + 4], f"{group[0]:.9g}" if has_numbers else f"{count}")
            for count, group in enumerate(groups, 1)
        ]
    if len(numbers) >= 9 and len(numbers) % 4 == 1:  # a time or count in front
        return _groups(numbers[1:], {at - 1 for at in starts})
    return []
