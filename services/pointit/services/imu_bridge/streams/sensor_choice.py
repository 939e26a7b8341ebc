"""Choice of one sensor among those whose readings arrive in one stream."""

import re

MAX_OTHERS = 8
"""Number of other sensors that a warning names."""
MAX_NUMBERS = 64
"""Number of different numbers without a repetition from which they are counts or times, not sensors."""
FORGET_AFTER = 500
"""Number of readings after which a sensor that is not heard any more is not named any more."""
_NUMBER = re.compile(r"[\d.:]+\Z")
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
        self._seen: set[str] = set()
        """Names that were read."""
        self._has_repeated = False
        """True if a name was read twice, so that numbers in names are those of sensors."""
        self._has_counts = False
        """True if numbers in names are counts or times."""
        self._count = 0
        self._others: dict[str, int] = {}
        """Names of other sensors, and the number of the last reading of each."""

    def accepts(self, *names: str) -> bool:
        """Return True if a reading of the sensor with `names`, such as a label and a number, is used."""
        if self._has_counts:
            names = tuple(name for name in names if not _NUMBER.match(name))
        name = " ".join(filter(None, names))
        self._count += 1
        is_new = name not in self._seen
        if is_new and len(self._seen) <= MAX_NUMBERS:
            self._seen.add(name)
            if len(self._seen) > MAX_NUMBERS and not (self._has_repeated or self._has_counts):
                self._has_counts, self.used = True, None
                self._others.clear()
                self._seen.clear()
                return self.accepts(*names)
        self._has_repeated |= not is_new
        if self._wanted:
            is_used = self._wanted == name.casefold() or self._wanted in _WORD.findall(name.casefold())
        elif self.used is None and self._is_noisy and is_new and name:
            return False
        else:
            is_used = self.used is None or name.casefold() == self.used.casefold()
        if is_used:
            self.used = name
            self._others.pop(name, None)
        elif name in self._others or len(self._others) < MAX_OTHERS:
            self._others[name] = self._count
        return is_used

    def is_other(self, *names: str) -> bool:
        """Return True if an event of the sensor with `names` is not of the one in use."""
        name = " ".join(filter(None, names))
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
