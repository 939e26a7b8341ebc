"""States of one reader: the last one of each writer that is there, also if it was sent before or got lost.

Like those of events, numbers of states are counted for each key and source. The last state of a writer is
fetched from its cache when it appears, and when its heartbeat has a later number.
"""

import asyncio
import collections
import contextlib
import threading
from collections.abc import Callable

import zenoh

from pointit.runtime.bus.memory_bus import Participant
from pointit.runtime.zenoh.event_recovery import MAX_KEYS, MAX_SOURCES, TIMEOUT_S, Source, parse_heartbeat
from pointit.runtime.zenoh.queries import ExcessReplies, ReplyLimit, query_samples

MAX_QUERIED = 32
"""Maximum number of sources of one key that are queried at a time. The others wait for a heartbeat."""
WAITS_S = (0.05, 0.2, 0.7)
"""Delays before a query without an answer is repeated, s: its writer may not be known everywhere yet."""
MAX_WRITERS_OF_KEY = 16
"""Maximum number of writers of one key whose states are fetched at the start."""


class StateRecovery:
    """Delivers the states of one reader, each of a writer once, and fetches those that it has not got."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        hand_on: Callable[[zenoh.Sample], None],
        *,
        max_bytes: int,
        max_names: int,
        excess: ExcessReplies | None = None,
    ) -> None:
        """Begin without states. Call this in the loop.

        `hand_on` gets each sample, in the loop or on Zenoh's threads, one at a time. `max_bytes`: maximum
        length of a sample. `max_names`: maximum number of names in keys of the reader. `excess` counts
        answers that were not asked for.
        """
        self._excess = excess
        self._bus = bus
        self._session = session
        self._hand_on = hand_on
        self._max_bytes = max_bytes
        self._max_names = max_names
        self._is_closed = False
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._keys: collections.OrderedDict[str, collections.OrderedDict[Source, int]] = (
            collections.OrderedDict()
        )
        """Last number of each source by key."""
        self._queried: dict[str, set[Source]] = {}
        """Sources that are being queried, by key."""

    def close(self) -> None:
        """Stop querying."""
        self._is_closed = True

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Deliver a state, unless it or a later one of its source was delivered. Any thread."""
        info = sample.source_info
        if info is None:
            self._hand_on(sample)
            return
        source = (str(info.source_id.zid), str(info.source_id.eid))
        number = info.source_sn
        with self._lock:
            key = str(sample.key_expr)
            numbers = self._keys.pop(key, None) or collections.OrderedDict[Source, int]()
            self._keys[key] = numbers
            last = numbers.pop(source, -1)
            numbers[source] = max(last, number)
            # Those that are silent longest are evicted, which bounds memory
            if len(numbers) > MAX_SOURCES:
                numbers.popitem(last=False)
            if len(self._keys) > MAX_KEYS:
                self._keys.popitem(last=False)
            if number > last:
                self._hand_on(sample)

    def on_heartbeat(self, heartbeat: zenoh.Sample) -> None:
        """Fetch the state of a writer whose heartbeat has a later number. Any thread."""
        parsed = parse_heartbeat(heartbeat)
        if parsed is None:
            return
        key, source, number = parsed
        with self._lock:
            numbers = self._keys.get(key)
            is_known = numbers is not None and numbers.get(source, -1) >= number
        if not is_known:
            self._fetch(key, source)

    def on_writer(self, token: zenoh.Sample) -> None:
        """Fetch the state of a writer that has come, whose `token` is KEY/@adv/pub/ZID/EID/_. Any thread."""
        if token.kind != zenoh.SampleKind.PUT:
            return
        key, _, path = str(token.key_expr).partition("/@adv/pub/")
        zid, _, rest = path.partition("/")
        eid = rest.partition("/")[0]
        if zid and eid:
            self._fetch(key, (zid, eid))

    def fetch_all(self, pattern: str) -> None:
        """Fetch the states of all writers of `pattern` that are there. Call this in the loop."""
        if not self._bus.is_closed:
            self._bus.spawn(self._query_all(pattern), f"fetching states of {pattern}")

    def _fetch(self, key: str, source: Source) -> None:
        with self._lock:
            queried = self._queried.setdefault(key, set())
            if source in queried or len(queried) >= MAX_QUERIED:
                return
            queried.add(source)

        def spawn_query() -> None:
            if not self._is_closed and not self._bus.is_closed:
                self._bus.spawn(self._query_source(key, source), f"fetching the state of {key}")

        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(spawn_query)

    async def _query_source(self, key: str, source: Source) -> None:
        zid, eid = source
        limit = ReplyLimit(1, self._max_bytes)
        try:
            await self._query(f"{key}/@adv/pub/{zid}/{eid}/**?_max=1", limit, source)
        finally:
            with self._lock:
                queried = self._queried.get(key, set())
                queried.discard(source)
                if not queried:
                    self._queried.pop(key, None)

    async def _query_all(self, pattern: str) -> None:
        limit = ReplyLimit(
            MAX_WRITERS_OF_KEY * self._max_names, self._max_bytes, max_of_key=MAX_WRITERS_OF_KEY
        )
        await self._query(f"{pattern}/@adv/pub/**?_max=1", limit, None)

    async def _query(self, selector: str, limit: ReplyLimit, source: Source | None) -> None:
        """Deliver the answers to `selector`, only those of `source` if it is given."""
        for wait_s in (0.0, *WAITS_S):
            await asyncio.sleep(wait_s)
            samples = await query_samples(
                self._session,
                selector,
                timeout_s=TIMEOUT_S,
                limit=limit,
                excess=self._excess,
                under_any_key=True,
            )
            if self._is_closed:
                return
            for sample in samples:
                info = sample.source_info
                if source is not None and info is not None:
                    stated = (str(info.source_id.zid), str(info.source_id.eid))
                    if stated != source:
                        continue
                self.on_sample(sample)
            if samples:
                return
