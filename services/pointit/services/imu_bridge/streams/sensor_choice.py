"""Choice of one sensor among those whose readings arrive in one stream."""

import re
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, count, pairwise

MAX_OTHERS = 8
"""Number of other sensors that a warning names."""
MAX_NAMES = 64
"""Number of different names from which counts or times may be among them."""
MIN_READINGS = 4
"""Smallest mean number of readings of each, else they are: counts that begin again return as well."""
MIN_SHARED = 3
"""Smallest number of such names that share a sensor's name. A time is shared by successive ones only."""
MIN_REPEATED = 8
"""Number of readings with the same name among the newest from which it is no count."""
FORGET_AFTER = 500
"""Number of readings after which a silent sensor is no longer named."""
_WORD = re.compile(r"[\w.\-]+")
_COUNTS = (re.compile(r"\d+"), re.compile(r"(?=[a-f]*\d)[\da-f]{2,}|\d|\b[\da-f]{4,}\b", re.IGNORECASE))
"""Parts of names that may be counts: decimal, then hexadecimal."""
_ANYTHING = re.compile(r".+", re.DOTALL)


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
        self._used_total = 0
        """Number of its readings in a row, without those of others."""
        self._used_names: tuple[str, ...] = ()
        self._seen: dict[tuple[str, ...], None] = {}
        """Names that were read, in their order."""
        self._shared: set[str] = set()
        """Names that tell sensors apart although others are counts or times."""
        self._counts: re.Pattern[str] | None = None
        """Parts of other names that are counts, or None while no counts are among them."""
        self._unshared: deque[str] = deque(maxlen=MAX_NAMES)
        """The newest names that are counts."""
        self._fixed: set[tuple[str, int]] = set()
        """Numbers in names that are no counts: the name with # for each of them, and which one."""
        self._changing = ""
        """Name of a reading, if the names of all of them differ and are no count, else `""`."""
        self._count = 0
        self._others: dict[str, int] = {}
        """Names of other sensors, and the number of the last reading of each."""

    def accepts(self, *names: str) -> bool:
        """Return True if a reading of the sensor with `names`, such as a label and a number, is used."""
        raw, names = names, self._names(names)
        name = " ".join(names)
        self._count += 1
        is_new = names not in self._seen and len(self._seen) <= MAX_NAMES
        if is_new:
            self._seen[names] = None
            is_full = len(self._seen) > MAX_NAMES
            if is_full and self._counts is None and self._count < MIN_READINGS * MAX_NAMES:
                self._find_counts()
                return self.accepts(*raw)
        is_doubtful = is_new and not self._wanted and (self._is_noisy or self._is_count(names))
        if self.used == "" and name and self._count - self._used_count > MAX_NAMES:
            self.used = None  # numbers are known as those of sensors after some readings
        if self._wanted:
            words = {name, *names, *raw, *_WORD.findall(" ".join((name, *raw)))}
            is_used = self._wanted in map(str.casefold, words)
        elif self.used is None and self._is_noisy and is_new and name:
            return False
        else:
            is_used = self.used is None or name.casefold() == self.used.casefold()
        if is_used:
            self._used_total = self._used_total + 1 if name == self.used else 1
            self.used, self._used_names, self._used_count = name, names, self._count
            self._others.pop(name, None)
        elif name in self._others or (len(self._others) < MAX_OTHERS and not is_doubtful):
            self._others[name] = self._count
        return is_used

    def _is_count(self, names: tuple[str, ...]) -> bool:
        """Return True if new `names` may be of the sensor in use with a count."""
        is_known = self._used_total >= MIN_SHARED and self._used_names != ()
        is_other = is_known and set(self._used_names).isdisjoint(names)
        return any(map(str.isdigit, "".join(names))) and not is_other

    def _find_counts(self) -> None:
        """Find the parts of the names that are counts or times, and tell sensors apart by the rest."""
        indices: dict[str, list[int]] = {}
        for index, names in enumerate(self._seen):
            for each in names:
                indices.setdefault(each, []).append(index)
        self._shared = {
            each for each, at in indices.items() if len(at) >= MIN_SHARED and at[-1] - at[0] >= MAX_NAMES // 2
        }
        remaining: set[tuple[str, ...]] = set()
        for self._counts in (*_COUNTS, _ANYTHING):
            parts: dict[str, list[list[str]]] = {}
            for each in chain(*(names for names in self._seen if self._shared.isdisjoint(names))):
                parts.setdefault(self._counts.sub("#", each), []).append(self._counts.findall(each))
            self._fixed = {
                (shape, at)
                for shape, rows in parts.items()
                for at, column in enumerate(zip(*rows, strict=True))
                if _are_fixed(column)
            }
            remaining = {tuple(self._without_counts(names)) for names in self._seen}
            if len(remaining) <= MAX_OTHERS:
                break
        is_count = all(len(names) == 1 and names[0].isdigit() for names in self._seen)
        is_count = is_count and all(int(a[0]) < int(b[0]) for a, b in pairwise(self._seen))
        self._changing = "" if is_count or any(remaining) else " ".join(next(reversed(self._seen)))
        self.used = None if self.used is None else " ".join(self._without_counts(self._used_names))
        self._others.clear()
        self._seen.clear()

    def _without_counts(self, names: Iterable[str]) -> Iterator[str]:
        for each in names:
            name = each if each in self._shared else self._masked(each)
            if any(map(str.isalnum, name)):
                yield name

    def _masked(self, name: str) -> str:
        """Return `name` with # for each count in it."""
        if self._counts is None:
            return name
        shape, index = self._counts.sub("#", name), count()
        return self._counts.sub(lambda part: part[0] if (shape, next(index)) in self._fixed else "#", name)

    def _names(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return those of `names` that tell sensors apart, without counts in them."""
        for each in names if self._counts else ():
            if each and each not in self._shared:
                self._unshared.append(each)
                if self._unshared.count(each) >= MIN_REPEATED:
                    self._shared.add(each)
        return tuple(self._without_counts(names))

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
        if self._wanted and self.used is not None:
            return ""
        if self._changing and not others:
            return (
                f"each reading names another sensor, the last {self._changing[:40]}, so that several cannot "
                f"be told apart; let it send a name that stays the same, and set {self._parameter} to it"
            )
        if not others:
            return ""
        if self._wanted:
            return f"no sensor {self._wanted!r} is heard, but {others}: set {self._parameter} to one of them"
        used = self.used or "one without a name"
        return (
            f"several sensors send in one stream: {used} is used, not {others}; set {self._parameter} to "
            "the one on the wrist"
        )


def _are_fixed(values: Sequence[str]) -> bool:
    """Return True if numbers in names of one form are those of sensors: they are the same, or return."""
    different, changes = len(set(values)), sum(a != b for a, b in pairwise(values))
    return different == 1 or (different <= MAX_NAMES // 2 and changes >= different)
