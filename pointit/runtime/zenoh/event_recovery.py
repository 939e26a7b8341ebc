"""Events of one reader, in the order of each writer, and those that a lost link has kept back.

After a link loss, the writer is queried for lost events until it answers. Later events wait for the missing
ones, so that events stay in order. Events before the first one that arrived from a writer are queried three
times, since they may also have been lost. Heartbeats of a writer show that its last event was lost.

A sample states its source (session, and number of the writer in it) and its number itself, and anybody may
state those of another. Its key is what access rules have checked. So numbers are counted for each key and
source, and nothing under one key changes what is delivered of another. Zenoh's own recovery (zenoh-ext 1.10)
counts by the source alone, so no topic is read with it. Only the ROS bridge uses it, on the network of ROS,
where anybody may write any key.
"""

import asyncio
import collections
import contextlib
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import zenoh

from pointit.runtime.bus.contract import EVENT_CAPACITY
from pointit.runtime.bus.memory_bus import Participant
from pointit.runtime.zenoh.queries import ExcessReplies, ReplyLimit, query_samples

Source = tuple[str, str]
"""Session id, and number of the writer in the session, as the writer states them."""

WAITS_S = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0, 2.0, 2.0, 2.0)
"""Delay before each query, s. An event that has not arrived after the last query counts as lost."""
MAX_OF_FIRST = 3
"""Number of queries for events before a writer's first event. Not every writer caches its events."""
TIMEOUT_S = 2.0
MAX_GAPS = 32
"""Maximum number of sources of one key that are queried at a time, which bounds memory. A person writes one
key of a topic only, so one identity keeps no other from being queried."""
MAX_SOURCES = 1000
"""Maximum number of stored sequence numbers of one key. The oldest is evicted, which bounds memory."""
MAX_KEYS = 4096
"""Maximum number of keys. The one that is silent longest is evicted, which bounds memory."""
HEARTBEAT_BYTES = 4


@dataclass(slots=True, eq=False)
class _Gap:
    """Missing samples of one source, and the later samples that wait for them."""

    about: str
    """Key of queries to the writer."""
    wanted: set[int] = field(default_factory=set[int])
    samples: dict[int, zenoh.Sample] = field(default_factory=dict[int, zenoh.Sample])
    given_up: int = 0
    """Number of lost samples that are not queried, since they exceed any writer's cache."""
    first_counted: int = 0
    """Sequence number before which missing samples, perhaps older than the reader, are not lost."""

    def want(self, numbers: range) -> None:
        """Note that samples of `numbers` are missing, which are later than all others.

        At most `EVENT_CAPACITY` are wanted at a time: no writer caches earlier ones any more.
        """
        self.wanted.update(numbers)
        if len(self.wanted) <= EVENT_CAPACITY:
            return
        earliest = numbers.stop - EVENT_CAPACITY
        for number in [number for number in self.wanted if number < earliest]:
            self.wanted.discard(number)
            if number >= self.first_counted and number not in self.samples:
                self.given_up += 1

    def add(self, number: int, sample: zenoh.Sample) -> None:
        """Add the answer to a query for a missing sample, unless it has arrived by itself."""
        if number in self.samples:
            return
        self.samples[number] = sample
        was_given_up = number not in self.wanted and number >= self.first_counted
        if was_given_up:
            self.given_up -= 1


@dataclass(slots=True, eq=False)
class _KeySources:
    """Sources that write one key."""

    last: collections.OrderedDict[Source, int] = field(default_factory=collections.OrderedDict[Source, int])
    """Last number of each source. The one that is silent longest comes first."""
    gaps: dict[Source, _Gap] = field(default_factory=dict[Source, _Gap])
    has_evicted: bool = False
    """True if a source that seems new may have been evicted."""

    def replace_last(self, source: Source, number: int) -> int | None:
        """Store `number` as the last one of `source`, unless a later one is there. Return the former one."""
        last = self.last.pop(source, None)
        self.last[source] = number if last is None else max(last, number)
        if len(self.last) > MAX_SOURCES:
            self.last.popitem(last=False)
            self.has_evicted = True
        return last


class EventRecovery:
    """Delivers the samples of one reader in the order of each writer, without gaps where possible."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        hand_on: Callable[[zenoh.Sample], None],
        lose: Callable[[int], None],
        *,
        max_bytes: int,
        excess: ExcessReplies | None = None,
    ) -> None:
        """Create an orderer without samples. Call this in the loop.

        `hand_on` gets each sample, in the loop or on Zenoh's threads, one at a time. `lose` gets the
        number of lost ones. `max_bytes`: maximum length of a sample. Longer ones never wait. `excess`
        counts answers that were not asked for.
        """
        self._excess = excess
        self._max_bytes = max_bytes
        self._bus = bus
        self._session = session
        self._hand_on = hand_on
        self._lose = lose
        self._loop = asyncio.get_running_loop()
        self._lock = threading.RLock()  # who gets a sample may close
        self._keys: collections.OrderedDict[str, _KeySources] = collections.OrderedDict()

    def close(self) -> None:
        """Discard waiting samples and stop querying."""
        with self._lock:
            for sources in self._keys.values():
                sources.gaps.clear()

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Add a sample that arrived. Each number of a source is delivered once. Any thread."""
        source_info = sample.source_info
        if source_info is None:
            self._hand_on(sample)
            return
        key = str(sample.key_expr)
        source = (str(source_info.source_id.zid), str(source_info.source_id.eid))
        number = source_info.source_sn
        with self._lock:
            sources = self._sources_of(key)
            last = sources.replace_last(source, number)
            gap = self._gap_before(key, sources, source, last=last, number=number)
            if gap is None:
                if last is None or number > last:
                    self._hand_on(sample)
                return  # else it was delivered before

            # Later samples wait for the missing ones, which keeps the writer's order. None replaces another
            is_missing = number in gap.wanted or last is None or number > last
            if not is_missing or number in gap.samples:
                return
            if len(sample.payload) > self._max_bytes:  # no reader takes it, so its bytes are not kept
                gap.wanted.discard(number)
                self._hand_on(sample)
                return
            gap.samples[number] = sample
            waiting = sum([len(other.samples) for other in sources.gaps.values()])
            if waiting >= EVENT_CAPACITY:
                self._close_gap(sources, source, gap)

    def on_heartbeat(self, heartbeat: zenoh.Sample) -> None:
        """Query a writer whose heartbeat has a later number than its last sample. Any thread."""
        parsed = parse_heartbeat(heartbeat)
        if parsed is None:
            return
        key, source, number = parsed
        with self._lock:
            sources = self._sources_of(key)
            last = sources.last.get(source)
            if last is not None and number <= last:
                return
            # Without room its next heartbeat, a moment later, says the same
            if source not in sources.gaps and len(sources.gaps) >= MAX_GAPS:
                return
            sources.replace_last(source, number)
            self._gap_before(key, sources, source, last=last, number=number + 1)

    def _sources_of(self, key: str) -> _KeySources:
        sources = self._keys.pop(key, None) or _KeySources()
        self._keys[key] = sources
        if len(self._keys) > MAX_KEYS:
            self._keys.popitem(last=False)
        return sources

    def _gap_before(
        self, key: str, sources: _KeySources, source: Source, *, last: int | None, number: int
    ) -> _Gap | None:
        """Note that the numbers between `last` and `number` are missing. Return the gap of `source`."""
        gap = sources.gaps.get(source)
        may_ask = gap is not None or len(sources.gaps) < MAX_GAPS
        is_first = last is None and not sources.has_evicted and may_ask
        if is_first:
            last = -1
        if last is None or number <= last + 1:
            return gap
        if not may_ask:
            self._lose(number - last - 1)
            return None

        # Query what is missing, except for more than any writer caches
        if gap is None:
            zid, eid = source
            gap = _Gap(f"{key}/@adv/pub/{zid}/{eid}/**")
            sources.gaps[source] = gap
            self._start_query(key, sources, source, gap)
        first = max(last + 1, number - EVENT_CAPACITY)
        if is_first:
            gap.first_counted = number
        else:
            gap.given_up += first - last - 1
        gap.want(range(first, number))
        return gap

    def _start_query(self, key: str, sources: _KeySources, source: Source, gap: _Gap) -> None:
        def spawn_query() -> None:
            if self._bus.is_closed:
                return
            querying = self._query_missing(key, sources, source, gap)
            self._bus.spawn(querying, f"asking for {gap.about}")

        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(spawn_query)

    async def _query_missing(self, key: str, sources: _KeySources, source: Source, gap: _Gap) -> None:
        for attempt, wait_s in enumerate(WAITS_S, 1):
            await asyncio.sleep(wait_s)
            with self._lock:
                if sources.gaps.get(source) is not gap:
                    return
                missing = gap.wanted - gap.samples.keys()
            if not missing:  # they arrived late without a query
                break
            # One sample more than the missing ones. Samples come in order, so that it, or the last missing
            # one, shows that the answer is complete.
            first = min(missing)
            beyond = max(missing) + 1
            selector = f"{gap.about}?_sn={first}..{beyond}"
            samples = await query_samples(
                self._session,
                selector,
                timeout_s=TIMEOUT_S,
                limit=ReplyLimit(beyond - first + 1, self._max_bytes),
                excess=self._excess,
                under_any_key=True,
            )
            answers = _by_number(samples, key, source)
            with self._lock:
                for number, sample in answers.items():
                    if number in missing:
                        gap.add(number, sample)
                has_sent_all = max(answers, default=-1) >= max(gap.wanted, default=-1)
                if attempt == MAX_OF_FIRST:
                    # samples from before the reader were queried often enough
                    gap.wanted = {number for number in gap.wanted if number >= gap.first_counted}
                if has_sent_all or gap.wanted <= gap.samples.keys():
                    break
        with self._lock:
            if sources.gaps.get(source) is gap:
                self._close_gap(sources, source, gap)

    def _close_gap(self, sources: _KeySources, source: Source, gap: _Gap) -> None:
        del sources.gaps[source]
        for number in sorted(gap.samples):
            self._hand_on(gap.samples[number])
        missing = gap.wanted - gap.samples.keys()
        lost = gap.given_up + sum([number >= gap.first_counted for number in missing])
        if lost:
            self._lose(lost)


def parse_heartbeat(heartbeat: zenoh.Sample) -> tuple[str, Source, int] | None:
    """Return key, source and last number of a writer's heartbeat, or None if it is none.

    Its key is KEY/@adv/pub/ZID/EID/_, and its payload the number, in four bytes.
    """
    key, _, path = str(heartbeat.key_expr).partition("/@adv/pub/")
    zid, _, rest = path.partition("/")
    eid = rest.partition("/")[0]
    if not eid.isdecimal() or len(heartbeat.payload) != HEARTBEAT_BYTES:
        return None
    number = int.from_bytes(heartbeat.payload.to_bytes(), "little")
    return key, (zid, eid), number


def _by_number(samples: Iterable[zenoh.Sample], key: str, source: Source) -> dict[int, zenoh.Sample]:
    """Return those of `samples` that have this key and source, by their sequence numbers."""
    numbered: dict[int, zenoh.Sample] = {}
    for sample in samples:
        info = sample.source_info
        if info is None or str(sample.key_expr) != key:
            continue
        if (str(info.source_id.zid), str(info.source_id.eid)) == source:
            numbered[info.source_sn] = sample
    return numbered
