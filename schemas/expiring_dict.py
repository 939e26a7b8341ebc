"""The newest value of each key, for a limited time and a limited number of keys. Pure.

People, trackers and processes fall silent without a word. A reader that keeps their last messages by name has
three rules: a value ends some time after it came, the oldest one makes room for a new key, and one that seems
to come from the future ends, too, since the clock was set back and its age is unknown.

    hovers = ExpiringDict[str, Hover](max_age_ns=NS_PER_S, max_keys=64)
    hovers.put("anna", hover, now_ns)
    for user in hovers.expire(now_ns):
        ...                                # anna has been silent for a second
    timer_ns = hovers.next_expiry_ns()     # nothing ends by itself: call `expire` again then
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Generic, TypeVar

K = TypeVar("K")
V = TypeVar("V")


class ExpiringDict(Mapping[K, V], Generic[K, V]):
    """A read-only mapping to the values, which are set by `put`."""

    def __init__(self, max_age_ns: int | Callable[[V], int], *, max_keys: int | None = None) -> None:
        """Create without values. `max_age_ns`: age at which a value ends, or a function of the value."""
        self._max_age_ns = max_age_ns
        self._max_keys = max_keys
        self._entries: dict[K, tuple[int, V]] = {}
        """By key: time of arrival, ns, and value."""

    def put(self, key: K, value: V, now_ns: int) -> None:
        """Set the value that came at `now_ns`."""
        self._entries.pop(key, None)  # so that the first key is the one that was silent for longest
        self._entries[key] = (now_ns, value)
        if self._max_keys is not None and len(self._entries) > self._max_keys:
            longest_silent = next(iter(self._entries))
            del self._entries[longest_silent]

    def discard(self, key: K) -> bool:
        """Forget a value. Return True if there was one."""
        return self._entries.pop(key, None) is not None

    def clear(self) -> None:
        """Forget all values."""
        self._entries.clear()

    def expire(self, now_ns: int) -> list[K]:
        """Forget the values that have ended. Return their keys."""
        ended = [key for key in self._entries if not 0 <= now_ns - self._entries[key][0] < self._age_ns(key)]
        for key in ended:
            del self._entries[key]
        return ended

    def next_expiry_ns(self) -> int | None:
        """Return the time at which the next value ends if none comes, or None if there are none."""
        return min((self._entries[key][0] + self._age_ns(key) for key in self._entries), default=None)

    def __getitem__(self, key: K) -> V:
        return self._entries[key][1]

    def __iter__(self) -> Iterator[K]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def _age_ns(self, key: K) -> int:
        if callable(self._max_age_ns):
            return self._max_age_ns(self._entries[key][1])
        return self._max_age_ns
