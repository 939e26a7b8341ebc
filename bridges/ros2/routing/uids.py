"""Numbers in ROS for our names and kinds of objects, and back."""

import re

MAX_NUMBER = 2**31 - 1
"""Fits `uint32` as well as the `int32` of a marker's id."""

MAX_NAMES = 100_000
"""Maximum number of remembered names, evicted by last use; a conveyor needs days for this many."""

_DIGITS = re.compile(r"([0-9]{1,10})\Z")


class Uids:
    """Numbers for names while they are in use: the digits a name ends with, if free."""

    def __init__(self, max_number: int = MAX_NUMBER, max_names: int = MAX_NAMES) -> None:
        """Use numbers from 0 to `max_number`, for at most `max_names` names at a time."""
        self._max_number = max_number
        self._max_names = min(max_names, max_number + 1)
        self._numbers: dict[str, int] = {}
        """Ordered by last use."""
        self._names: dict[int, str] = {}
        self._next = max_number // 2 + 1
        self._awaited: set[int] = set()

    def number(self, name: str) -> int:
        """Return the number of `name`; a new name gets one."""
        number = self._numbers.pop(name, None)
        if number is None:
            number = self._new(name)
            self._names[number] = name
        self._numbers[name] = number
        return number

    def bind(self, number: int, name: str) -> None:
        """Bind `number`, which a name can have, to `name`, and release it from another name."""
        for old in (self._names.get(number), name):
            if old is not None and old in self._numbers:
                del self._names[self._numbers.pop(old)]
        self._numbers[name] = number
        self._names[number] = name

    def claim(self, number: int, name: str) -> None:
        """Bind `number`, if a name can have such a one, to `name`, unless it has it."""
        if number <= self._max_number and self._names.get(number) != name:
            self.bind(number, name)

    def reserve(self, number: int) -> None:
        """Reserve `number` for the next new name; until `end_reservation` that may be any."""
        self._awaited.add(number)

    def end_reservation(self, number: int) -> None:
        """End the reservation of `number`."""
        self._awaited.discard(number)

    def is_settled(self, name: str) -> bool:
        """Return True if the number of `name` is final: it has one, or nothing is reserved."""
        return not self._awaited or name in self._numbers

    def _new(self, name: str) -> int:
        if len(self._numbers) >= self._max_names:
            oldest = next(iter(self._numbers))
            del self._names[self._numbers.pop(oldest)]
        digits = _DIGITS.search(name)
        if digits is not None:
            number = int(digits.group(1))
            if number <= self._max_number and number not in self._names:
                return number
        while self._next in self._names:
            has_higher = self._next < self._max_number
            self._next = self._next + 1 if has_higher else 0
        return self._next


class Kinds:
    """Kinds of objects as the numbers 0 to 255 of the ROS toolkit's `type` and `kind`."""

    OTHER = 255
    """Number of kinds without one."""

    def __init__(self, kinds: tuple[str, ...]) -> None:
        self._kinds = kinds
        numbered = tuple(enumerate(kinds))
        self._numbers = {kind: number for number, kind in reversed(numbered)}  # of equal ones the first

    def number(self, kind: str) -> int:
        """Return the number of `kind`."""
        return self._numbers.get(kind, self.OTHER)

    def kind(self, number: int) -> str | None:
        """Return the kind of `number`, or None if there is none."""
        if not 0 <= number < len(self._kinds):
            return None
        return self._kinds[number]

    def __str__(self) -> str:
        """Return the kinds for messages."""
        pairs = (f"{number} {kind}" for number, kind in enumerate(self._kinds))
        return ", ".join(pairs)
