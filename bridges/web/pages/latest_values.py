"""Newest messages that each page has not yet got, within the rate of its link.

The site's time does not reveal it, since that comes over the same link. Health reports are stamped by the
clocks of their machines.

A cache keeps the newest message of every key as bytes, encoded once for all pages, and the last events. A
page's feed knows how far the page has come. A slow page misses states in between, never the newest, and
costs the other pages nothing.
"""

import math
from collections import OrderedDict, deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pointit.bridges.web.wire import IN_FLIGHT
from pointit.runtime.bus.timeliness import ClockSkewMonitor
from pointit.schemas import Health, pack
from pointit.schemas.topics import Delivery, Topic

Change = tuple[str, str, bytes | None]
"""Key pattern, name for its placeholder, the message's bytes or None if no longer valid."""

LINK_WINDOW_S = 3.0
"""Window (s) of which the fastest report counts."""

LINK_LAG_S = 1.0
"""Delays above this are reported."""

MAX_KEYS = 4096
"""Maximum number of states. More indicate a fault and are refused."""

MAX_EVENTS = 1024
"""Maximum number of events that a page may lag behind."""

HISTORY = 200
"""Number of past events that a new page gets, for its messages."""


class TokenBucket:
    """Token bucket: `rate_hz` a second in the long run, `burst` at once."""

    def __init__(self, rate_hz: float, burst: float) -> None:
        self._rate_hz = rate_hz
        self._burst = burst
        self._level = burst
        self._at_s = -math.inf

    def take(self, now_s: float) -> bool:
        """Remove a token. Return False if there is none."""
        if self.wait_s(now_s) > 0.0:
            return False
        self._level -= 1.0
        return True

    def wait_s(self, now_s: float, min_tokens: float = 1.0) -> float:
        """Return the delay until `min_tokens` tokens (at most `burst`) are there, s."""
        passed_s = max(0.0, now_s - self._at_s)
        self._level = min(self._burst, self._level + passed_s * self._rate_hz)
        self._at_s = max(self._at_s, now_s)
        return max(0.0, (min_tokens - self._level) / self._rate_hz)

    def reserve(self, now_s: float) -> float:
        """Remove a token that may come later, and return the time until it does, s."""
        wait_s = self.wait_s(now_s)
        self._level -= 1.0
        return wait_s


class SlowLink:
    """Compares the stamps of other machines' reports with their arrival times."""

    def __init__(self, host: str) -> None:
        self._monitor = ClockSkewMonitor(host, LINK_WINDOW_S)

    def hear(self, health: Health, arrived_ns: int, now_s: float, person: str) -> None:
        """Process a report that arrived at `arrived_ns` (own clock, Unix ns); `now_s` is monotonic."""
        if health.host:
            self._monitor.on_report(health.host, health.stamp_ns, arrived_ns, now_s, person)

    def sentence(self, now_s: float) -> str:
        """Return a warning with its remedy, or `""` if there is no delay."""
        sentences: list[str] = []
        for skew in self._monitor.skews(now_s):
            # A machine that claims another one's name is no link
            if skew.claimant or skew.ahead_s > -LINK_LAG_S:
                continue
            sentences.append(
                f"messages of {skew.host} reach {self._monitor.here} {-skew.ahead_s:.1f} s late, so the page "
                "is behind: the link between the two machines is slow or full, or their clocks differ"
            )
        return "; ".join(sentences)


@dataclass(frozen=True, slots=True)
class Batch:
    """Changes sent to a page at once."""

    n: int
    states: tuple[Change, ...]
    events: tuple[Change, ...]
    dropped: int
    """Events that this page has missed since the batch before."""

    def packed(self, sent_ns: int, speed: float) -> bytes:
        """Return it encoded; `sent_ns` is the site's time, which runs `speed` times as fast as the wall's."""
        return pack([self.n, sent_ns, speed, self.states, self.events, self.dropped])


@dataclass(slots=True)
class _Entry:
    version: int
    change: Change


class LatestValueCache:
    """The newest of every key, and the last events."""

    def __init__(self, max_keys: int = MAX_KEYS, max_events: int = MAX_EVENTS) -> None:
        self._max_keys = max_keys
        self._entries: OrderedDict[tuple[str, str], _Entry] = OrderedDict()
        """By key pattern and name, ordered by version."""
        self._version = 0
        self.urgent_version = 0
        """Version of the newest urgent state."""
        self._events: deque[tuple[int, Change]] = deque(maxlen=max_events)
        """With their stamps, in order of arrival."""
        self.began_ns = 0
        """Start of the run. History holds no events before it."""
        self._past: list[tuple[int, Change]] = []
        """Events that were not received here, see `recall`."""
        self._event_count = 0
        """Number of events so far, including those dropped from the ring."""
        self._feeds: set[PageFeed] = set()

    def has_room(self, topic: Topic[Any], name: str) -> bool:
        """Return True if a message of `topic` at `name` may be put."""
        if topic.delivery is Delivery.EVENT or (topic.key, name) in self._entries:
            return True
        if len(self._entries) >= self._max_keys:
            self._drop_gone()
        return len(self._entries) < self._max_keys

    def put(
        self, topic: Topic[Any], name: str, payload: bytes, *, stamp_ns: int = 0, urgent: bool = False
    ) -> None:
        """Store a message of `topic` at `name`.

        `urgent` messages wait only for slow pages, see `PageFeed.wait_s`. Events are sorted into the history
        by `stamp_ns`.
        """
        change = (topic.key, name, payload)
        if topic.delivery is Delivery.EVENT:
            self._events.append((stamp_ns, change))
            self._event_count += 1
            return
        self._store_change(change)
        if urgent:
            self.urgent_version = self._version

    def recall(self, past: Iterable[tuple[int, Change]]) -> None:
        """Set events, with their stamps, that were not received here; they replace those set before."""
        self._past = list(past)

    def history(self) -> list[Change]:
        """Return the last `HISTORY` events of the run, including recalled ones, oldest first."""
        all_events = (*self._past, *self._events)
        events_of_run = [event for event in all_events if event[0] >= self.began_ns]
        events_of_run.sort(key=lambda event: event[0])
        return [change for _, change in events_of_run[-HISTORY:]]

    def forget(self, topic: Topic[Any], name: str) -> None:
        """Mark a key's message as no longer valid, if there is one."""
        entry = self._entries.get((topic.key, name))
        if entry is not None and entry.change[2] is not None:
            self._store_change((topic.key, name, None))

    def become(self, other: "LatestValueCache") -> None:
        """Hold the states of `other`. Pages get the differences, and no event that they do not have yet."""
        old_states = self.states_since(0)
        new_states = other.states_since(0)

        # Deletions, then all that differs
        new_keys = {(key, name) for key, name, _ in new_states}
        for key, name, _ in old_states:
            if (key, name) not in new_keys:
                self._store_change((key, name, None))
        held = set(old_states)
        for change in new_states:
            if change not in held:
                self._store_change(change)

        self._events.clear()
        self._past = []
        for feed in self._feeds:
            feed.skip_events()

    def names(self, topic: Topic[Any]) -> list[str]:
        """Return the names with a valid message of `topic`."""
        names: list[str] = []
        for (key, name), entry in self._entries.items():
            if key == topic.key and entry.change[2] is not None:
                names.append(name)
        return names

    def open(self, rate_hz: float) -> "PageFeed":
        """Return the feed of a new page with at most `rate_hz` batches a second."""
        feed = PageFeed(self, rate_hz)
        self._feeds.add(feed)
        return feed

    def close(self, feed: "PageFeed") -> None:
        """Forget `feed`."""
        self._feeds.discard(feed)

    @property
    def version(self) -> int:
        """Return the number of changes of states."""
        return self._version

    @property
    def event_count(self) -> int:
        """Return the number of events."""
        return self._event_count

    def states_since(self, version: int) -> list[Change]:
        """Return changes after `version`, oldest first; deletions only of keys that the page knows."""
        new: list[Change] = []
        for entry in reversed(self._entries.values()):
            if entry.version <= version:
                break
            if version or entry.change[2] is not None:
                new.append(entry.change)
        new.reverse()
        return new

    def events_since(self, count: int) -> list[Change]:
        """Return the events after the first `count` that are still kept."""
        kept = len(self._events)
        behind = min(self._event_count - count, kept)
        return [self._events[index][1] for index in range(kept - behind, kept)]

    def _store_change(self, change: Change) -> None:
        key = (change[0], change[1])
        self._entries.pop(key, None)
        self._version += 1
        self._entries[key] = _Entry(self._version, change)

    def _drop_gone(self) -> None:
        """Remove what is no longer valid, as all pages know."""
        sent_version = min((feed.version for feed in self._feeds), default=self._version)
        for key, entry in list(self._entries.items()):
            if entry.change[2] is None and entry.version <= sent_version:
                del self._entries[key]


class PageFeed:
    """Progress of one page."""

    def __init__(self, cache: LatestValueCache, rate_hz: float) -> None:
        self._cache = cache
        self._token_bucket = TokenBucket(rate_hz, 2.0)
        self._sent = 0
        self._acked = 0
        self._unacknowledged: set[int] = set()
        """Numbers of the last batches that may still be acknowledged, each once."""
        self._history = cache.history()
        """Past events that the page has not yet got."""
        self._events = cache.event_count
        self.version = 0
        """Version of the newest state sent to the page."""
        self.dropped = 0
        """Events that this page has missed so far."""

    @property
    def in_flight(self) -> int:
        """Return the number of unacknowledged batches."""
        return self._sent - self._acked

    def wait_s(self, now_s: float) -> float | None:
        """Return the delay (s) after which `take` has a batch, or None if not before something changes.

        Of two batches that may be sent at once one is reserved for urgent states, which would otherwise wait
        for the batch just before.
        """
        is_behind = self.version < self._cache.version or self._events < self._cache.event_count
        if not is_behind and not self._history:
            return None
        if self.in_flight >= IN_FLIGHT:
            return None
        is_urgent = self.version < self._cache.urgent_version
        return self._token_bucket.wait_s(now_s, 1.0 if is_urgent else 2.0)

    def take(self, now_s: float) -> Batch | None:
        """Return the next batch, or None if nothing is new, it is too early, or too many are in flight."""
        if self.wait_s(now_s) != 0.0:
            return None

        # All that is new
        cache = self._cache
        states = tuple(cache.states_since(self.version))
        events = cache.events_since(self._events)
        dropped = cache.event_count - self._events - len(events)
        history = self._history
        self._history = []
        self.version = cache.version
        self._events = cache.event_count
        self.dropped += dropped

        # A new page may be behind only by deletions, which it does not get
        has_changes = states or history or events
        if not has_changes and not dropped:
            return None
        self._token_bucket.take(now_s)
        self._sent += 1
        self._unacknowledged.add(self._sent)
        return Batch(self._sent, states, (*history, *events), dropped)

    def skip_events(self) -> None:
        """Send no event of before."""
        self._events = self._cache.event_count
        self._history = []

    def ack(self, n: int) -> bool:
        """Acknowledge batch `n` and all before. Return False if `n` was not sent, or is acknowledged already.

        Acknowledgements may overtake each other: those of the last `IN_FLIGHT` batches may come once each.
        """
        if n not in self._unacknowledged:
            return False
        self._acked = max(self._acked, n)
        self._unacknowledged.discard(n)
        lost = self._acked - IN_FLIGHT
        self._unacknowledged = {number for number in self._unacknowledged if number > lost}
        return True
