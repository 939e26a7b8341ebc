"""Source of a playback: entries in order of time, and the newest entry of every key at an instant."""

import functools
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

from pointit.bridges.web.wire import Timeline
from pointit.recording.entries import Entry
from pointit.schemas import Message, decode, encode
from pointit.schemas.topics import SERVICE_ALIVE, USER_ALIVE, Presence, Topic
from pointit.services.shown_topics import SHOWN

SHOWN_ROWS: tuple[Topic[Any] | Presence, ...] = (*SHOWN, SERVICE_ALIVE, USER_ALIVE)
"""Rows of the topic table that pages need."""

Key = tuple[str, str]
"""Key pattern, and what stands for its placeholder."""


class Moment(NamedTuple):
    """An entry, encoded: a fraction of the size of its message in memory."""

    time_ns: int
    row: Topic[Any] | Presence
    name: str
    payload: bytes
    """The message as on the bus. Of a presence: not empty if it begins."""

    def entry(self) -> Entry:
        """Return it decoded."""
        body = decode(self.row.message, self.payload) if isinstance(self.row, Topic) else bool(self.payload)
        return Entry(self.time_ns, self.row.at(self.name), self.row, self.name, body)


class Past(Protocol):
    """Source of a playback. Times are the site's, ns."""

    site: str
    began_ns: int
    ended_ns: int
    read_ns: int
    """Seeks are possible until then."""

    def states_at(self, at_ns: int) -> list[Entry]:
        """Return the newest entry of every key that is not later than `at_ns`, in order of time."""
        ...

    def entries(self, after_ns: int) -> Iterator[Entry]:
        """Return the entries later than `after_ns`, in order of time."""
        ...

    def timeline(self) -> Timeline:
        """Return the lanes as far as they are read."""
        ...


def moment(entry: Entry) -> Moment:
    """Return `entry`, whose row is in `SHOWN_ROWS`, encoded."""
    assert isinstance(entry.row, (Topic, Presence))  # noqa: S101 - requests are not shown
    payload = encode(entry.body) if isinstance(entry.body, Message) else b"1" if entry.body else b""
    return Moment(entry.time_ns, entry.row, entry.name, payload)


@functools.lru_cache(maxsize=4096)
def is_shown(key: str) -> bool:
    """Return True if `key` belongs to a row that pages need."""
    return any(row.name_in(key) if row.placeholder else row.key == key for row in SHOWN_ROWS)


def in_order(moments: dict[Key, Moment], newer: dict[Key, Entry]) -> list[Entry]:
    """Return the entries of both, of each key the newer, in order of time."""
    kept = [each.entry() for key, each in moments.items() if key not in newer]
    return sorted([*kept, *newer.values()], key=lambda entry: entry.time_ns)
