"""Choice of one sensor among those whose readings arrive in one stream."""

import re
from collections import Counter
from itertools import chain

MAX_OTHERS = 8
"""Number of other sensors that a warning names."""
MAX_NAMES = 64
"""Number of different names from which counts or times may be among them."""
MIN_READINGS = 4
"""Smallest mean number of readings of each, else they are: counts that begin again return as well."""
MIN_SHARED = 8
"""Smallest number of such names that share what tells sensors apart."""
FORGET_AFTER = 500
"""Number of readings after which a sensor that is not heard any more is not named any more."""
_WORD = re.compile(r"[\w.\-]+")


class SensorChoice:
    """Uses the sensor that is configured, else the first, and reports the others. They never replace it."""

    def __init__(self, parameter: str, wanted: str = "", *, is_noisy: bool = False) -> None:
        """Use the sensor whose name, or a word of it, is `wanted`; `""`: the first one.

        Args:
            parameter: that sets `wanted`, for the warning.
            wanted: name, number or address.
            is_noisy: the stream has no checksum, so that a name counts only when it is repeated.
        """
        self._parameter = parameter
        self._wanted = wanted.strip().casefold()
        self._is_noisy = is_noisy
        self.used: str | None = None
        """Name of the sensor in use; `""` if it has none."""
        self._used_count = 0
        """Number of its last reading."""
        self._seen: set[tuple[str, ...]] = set()
        """Names that were read."""
        self._shared: frozenset[str] | None = None
        """Names that tell sensors apart if others are counts or times, else None."""
        self._count = 0
        self._others: dict[str, int] = {}
        """Names of other sensors, and the number of the last reading of each."""

    def accepts(self, *names: str) -> bool:
        """Return True if a reading of the sensor with `names`, such as a label and a number, is used."""
        names = self._names(names)
        name = " ".join(names)
        self._count += 1
        is_new = names not in self._seen and len(self._seen) <= MAX_NAMES
        if is_new:
            self._seen.add(names)
            is_full = len(self._seen) > MAX_NAMES
            if is_full and self._shared is None and self._count < MIN_READINGS * MAX_NAMES:
                counts = Counter(chain.from_iterable(self._seen))
                self._shared = frozenset(each for each, count in counts.items() if count >= MIN_SHARED)
                self.used = None
                self._others.clear()
                self._seen.clear()
                return self.accepts(*names)
        is_doubtful = is_new and not self._wanted and (self._is_noisy or any(map(str.isdigit, name)))
        if self.used == "" and name and self._count - self._used_count > MAX_NAMES:
            self.used = None  # numbers are known as those of sensors after some readings
        if self._wanted:
            words = {name, *names, *_WORD.findall(name)}
            is_used = self._wanted in map(str.casefold, words)
        elif self.used is None and self._is_noisy and is_new and name:
            return False
        else:
            is_used = self.used is None or name.casefold() == self.used.casefold()
        if is_used:
            self.used, self._used_count = name, self._count
            self._others.pop(name, None)
        elif name in self._others or (len(self._others) < MAX_OTHERS and not is_doubtful):
            self._others[name] = self._count
        return is_used

    def _names(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return those of `names` that tell sensors apart."""
        return tuple(each for each in names if each and (self._shared is None or each in self._shared))

    def is_other(self, *names: str) -> bool:
        """Return True if an event of the sensor with `names` is not of the one in use."""
        name = " ".join(self._names(names))
        return name in self._others or (bool(name) and self.used is not None and name != self.used)

    @property
    def others(self) -> tuple[str, ...]:
        """Return the names of other sensors, `""` for one without a name."""
        return tuple(self._others)

    @property
    def warning(self) -> str:
        """Return the warning that other sensors are heard, or `""`. Those of a configured one need none."""
        self._others = {name: n for name, n in self._others.items() if self._count - n < FORGET_AFTER}
        others = ", ".join(name or "one without a name" for name in self._others)
        if not others or (self._wanted and self.used is not None):
            return ""
        if self._wanted:
            return f"no sensor {self._wanted!r} is heard, but {others}: set {self._parameter} to one of them"
        used = self.used or "one without a name"
        return (
            f"several sensors send in one stream: {used} is used, not {others}; set {self._parameter} to "
            "the one on the wrist"
        )
