"""What is newest on the bus, and what of it is new to each page: newest wins, events in order.

A hub keeps of every key the newest message as bytes, encoded once for all pages, and the last events. A
page's feed knows how far the page has come; a page that is slow misses states in between, never the newest,
and costs the others nothing.
"""

from collections import OrderedDict, deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pointit.bridges.web.pages.rate_limit import TokenBucket
from pointit.bridges.web.wire import IN_FLIGHT
from pointit.schemas import pack
from pointit.schemas.topics import Delivery, Topic

MOST_KEYS = 4096
"""States that are kept; more can only be a fault, and are refused."""

MOST_EVENTS = 1024
"""Events that a page may lag behind."""

HISTORY = 200
"""Last events that a page is told that comes late, for its messages."""

MOST_GONE = 256
"""Keys kept as gone for pages that have not been told; more are looked through for those that all know."""

News = tuple[str, str, bytes | None]
"""Key pattern, what stands for its placeholder, the message's bytes; none: no longer true."""


@dataclass(frozen=True, slots=True)
class Batch:
    """What a page is sent at once."""

    n: int
    states: tuple[News, ...]
    events: tuple[News, ...]
    dropped: int
    """Events that this page has missed since the batch before."""

    def packed(self, sent_ns: int, speed: float) -> bytes:
        """Return it as it travels; `sent_ns` is the site's time, which runs `speed` times as fast as ours."""
        return pack([self.n, sent_ns, speed, self.states, self.events, self.dropped])


@dataclass(slots=True)
class _Entry:
    version: int
    news: News


class LatestValueCache:
    """The newest of every key, and the last events."""

    def __init__(self, most_keys: int = MOST_KEYS, most_events: int = MOST_EVENTS) -> None:
        self._most_keys = most_keys
        self._entries: OrderedDict[tuple[str, str], _Entry] = OrderedDict()
        """By key pattern and name, in the order of their versions."""
        self._version = 0
        self.urgent_version = 0
        """Of the newest state that is not to wait."""
        self._events: deque[tuple[int, News]] = deque(maxlen=most_events)
        """With their stamps, in the order of their coming."""
        self._past: list[tuple[int, News]] = []
        """Events that did not come here, see `recall`."""
        self._event_count = 0
        """Events so far, those that have fallen out of the ring too."""
        self._gone = 0
        self._feeds: set[PageFeed] = set()

    def put(
        self, topic: Topic[Any], name: str, payload: bytes, *, stamp_ns: int = 0, urgent: bool = False
    ) -> bool:
        """Take a message of `topic` at `name`. Return True if there was room for its key.

        What is `urgent` waits for nothing but pages that are slow, see `PageFeed.wait_s`. By their `stamp_ns`
        events have their place in the history.
        """
        news = (topic.key, name, payload)
        if topic.delivery is Delivery.EVENT:
            self._events.append((stamp_ns, news))
            self._event_count += 1
            return True
        if (topic.key, name) not in self._entries and len(self._entries) >= self._most_keys:
            self._drop_gone()
            if len(self._entries) >= self._most_keys:
                return False
        self._set(news)
        if urgent:
            self.urgent_version = self._version
        return True

    def recall(self, past: Iterable[tuple[int, News]]) -> None:
        """Take events, with their stamps, that did not come here; they replace those recalled before."""
        self._past = list(past)

    def history(self) -> list[News]:
        """Return the last `HISTORY` events, those that were recalled too, the latest last."""
        happened = sorted((*self._past, *self._events), key=lambda event: event[0])
        return [news for _, news in happened[-HISTORY:]]

    def forget(self, topic: Topic[Any], name: str) -> bool:
        """Say that what was put last is no longer true. Return True if there was something."""
        entry = self._entries.get((topic.key, name))
        if entry is None or entry.news[2] is None:
            return False
        self._set((topic.key, name, None))
        if self._gone > MOST_GONE or not self._feeds:
            self._drop_gone()
        return True

    def names(self, topic: Topic[Any]) -> list[str]:
        """Return at which names something of `topic` is true."""
        return [
            name
            for (key, name), entry in self._entries.items()
            if key == topic.key and entry.news[2] is not None
        ]

    def open(self, rate_hz: float) -> "PageFeed":
        """Return the feed of a new page that is sent at most `rate_hz` batches a second."""
        feed = PageFeed(self, rate_hz)
        self._feeds.add(feed)
        return feed

    def close(self, feed: "PageFeed") -> None:
        """Forget `feed`."""
        self._feeds.discard(feed)

    @property
    def version(self) -> int:
        """Return how many changes of states there were."""
        return self._version

    @property
    def event_count(self) -> int:
        """Return how many events there were."""
        return self._event_count

    def states_since(self, version: int) -> list[News]:
        """Return what has changed after `version`, oldest first; what is gone only for who knows of it."""
        new: list[News] = []
        for entry in reversed(self._entries.values()):
            if entry.version <= version:
                break
            if version or entry.news[2] is not None:
                new.append(entry.news)
        new.reverse()
        return new

    def events_since(self, count: int) -> list[News]:
        """Return the events after the first `count`, as far as they are still there."""
        behind = min(self._event_count - count, len(self._events))
        start = len(self._events) - behind
        return [self._events[index][1] for index in range(start, len(self._events))]

    def _set(self, news: News) -> None:
        key = (news[0], news[1])
        before = self._entries.pop(key, None)
        if before is not None and before.news[2] is None:
            self._gone -= 1
        if news[2] is None:
            self._gone += 1
        self._version += 1
        self._entries[key] = _Entry(self._version, news)

    def _drop_gone(self) -> None:
        told = min((feed.version for feed in self._feeds), default=self._version)
        gone = [
            key for key, entry in self._entries.items() if entry.news[2] is None and entry.version <= told
        ]
        for key in gone:
            del self._entries[key]
        self._gone -= len(gone)


class PageFeed:
    """How far one page has come."""

    def __init__(self, hub: LatestValueCache, rate_hz: float) -> None:
        self._hub = hub
        self._pace = TokenBucket(rate_hz, 2.0)
        self._sent = 0
        self._acked = 0
        self._history = hub.history()
        """What the page is yet to be told of before it came."""
        self._events = hub.event_count
        self.version = 0
        """Of the newest state that the page was sent."""
        self.dropped = 0
        """Events that this page has missed so far."""

    @property
    def in_flight(self) -> int:
        """Return how many batches the page has not acknowledged."""
        return self._sent - self._acked

    def wait_s(self, now_s: float) -> float | None:
        """Return in how many seconds `take` has something as things stand; none: not before they change.

        Of two batches that may be sent at once one is left for what is urgent: it would wait for what came
        just before it otherwise.
        """
        is_behind = self.version < self._hub.version or self._events < self._hub.event_count
        if not (is_behind or self._history) or self.in_flight >= IN_FLIGHT:
            return None
        is_urgent = self.version < self._hub.urgent_version
        return self._pace.wait_s(now_s, 1.0 if is_urgent else 2.0)

    def take(self, now_s: float) -> Batch | None:
        """Return what is new to the page; none: nothing, too early, or too much is on its way already."""
        if self.wait_s(now_s) != 0.0:
            return None
        hub = self._hub
        states = tuple(hub.states_since(self.version))
        events = hub.events_since(self._events)
        dropped = hub.event_count - self._events - len(events)
        history, self._history = self._history, []
        self.version, self._events = hub.version, hub.event_count
        self.dropped += dropped
        if not states and not history and not events and not dropped:
            return None
        self._pace.take(now_s)
        self._sent += 1
        return Batch(self._sent, states, (*history, *events), dropped)

    def ack(self, n: int) -> bool:
        """Take the page's word that it shows batch `n`, and so all before. Return True if that can be."""
        if not 0 < n <= self._sent:
            return False
        self._acked = max(self._acked, n)
        return True
