"""A limit on the names that a reader accepts, so that a stranger cannot flood it with new ones."""

import collections
import threading
from collections.abc import Callable, Iterable

from pointit.schemas import KeyNameError

MAX_USERS = 256
MAX_NAMES = 4096
"""Limit for all placeholders but users: lamps, service instances."""

SILENT_S = 60.0
"""A name that was not heard for so long gives way to a new one."""


class Places:
    """Names that every reader of a bus takes, whatever strangers make up: the map's lamps."""

    def __init__(self) -> None:
        self._kept: dict[str, frozenset[str]] = {}

    def keep(self, placeholder: str, names: Iterable[str]) -> None:
        """Keep places for `names`, in place of those kept for `placeholder` before."""
        self._kept[placeholder] = frozenset(names)

    def holds(self, placeholder: str, name: str) -> bool:
        """Return True if a place is reserved for `name`. Any thread."""
        return name in self._kept.get(placeholder, ())


def max_names_for(placeholder: str) -> int:
    """Return the number of names that a reader accepts for `{placeholder}` of a key."""
    return MAX_USERS if placeholder == "user" else MAX_NAMES


class NameLimiter:
    """The names one reader hears; from any thread.

    Readers keep something for each name (a publisher, a tracker), so a flood of new ones would take the
    time and memory of those who were there before.
    """

    def __init__(self, placeholder: str, name_in: Callable[[str], str], places: Places) -> None:
        """Take what stands for `placeholder`.

        Args:
            placeholder: of the topic's key.
            name_in: reads the name from a key; raises `SchemaError`.
            places: names that are taken however many others there are.
        """
        self._places = places
        self._what = placeholder or "name"
        self._limit = max_names_for(placeholder)
        self._name_in = name_in
        self._lock = threading.Lock()
        self._heard: collections.OrderedDict[str, tuple[str, float]] = collections.OrderedDict()
        """By key: its name and when it was last heard, s; the one longest silent first."""

    def admit(self, key: str, now_s: float) -> str:
        """Return the name in `key`, which was heard at `now_s`.

        Raises:
            SchemaError: there cannot be such a name, or there are too many others.
        """
        with self._lock:
            known = self._heard.get(key)
            if known is not None:
                self._heard[key] = (known[0], now_s)
                self._heard.move_to_end(key)
                return known[0]
        name = self._name_in(key)
        with self._lock:
            is_known = self._places.holds(self._what, name)
            if key not in self._heard and len(self._heard) >= self._limit and not is_known:
                _, oldest_s = next(iter(self._heard.values()))
                if now_s - oldest_s <= SILENT_S:
                    raise KeyNameError(
                        f"{self._what} {name!r}: more than {self._limit} names, the rest are not heard; "
                        f"a name makes room when it is silent for {SILENT_S:g} s"
                    )
                self._heard.popitem(last=False)
            self._heard[key] = (name, now_s)
        return name
