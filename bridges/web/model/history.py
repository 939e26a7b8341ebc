"""Selection events from before this server started, queried from the selector's journal.

No core: it asks the selector and waits for the answer.
"""

import asyncio
import logging
from collections import deque

from pointit.bridges.web.pages.latest_values import HISTORY, MAX_EVENTS, Change, LatestValueCache
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import Clock
from pointit.runtime.errors import NoAnswerError, PointItError
from pointit.schemas import NS_PER_S, ReadHistory, SelectionEvent, encode
from pointit.schemas.topics import READ_HISTORY, SELECTION_EVENTS

log = logging.getLogger(__name__)

Identity = tuple[int, int, str, str]

SELECTOR = "selector"

BACK_NS = 86_400 * NS_PER_S
"""Maximum age of queried events: messages show a time of day, no date."""

AHEAD_NS = 60 * NS_PER_S
"""Maximum time in the future. Later events belong to another run with simulated time: no two clocks differ by
this much."""

QUERY_TIMEOUT_S = 1.0
"""Timeout (s) of the query: pages wait for the first reply."""


class EventHistory:
    """Adds events to a cache that it has not received itself."""

    def __init__(self, bus: ServiceBus, clock: Clock, cache: LatestValueCache) -> None:
        self._bus = bus
        self._clock = clock
        self._cache = cache
        self._received: deque[Identity] = deque(maxlen=MAX_EVENTS)
        self._is_wanted = asyncio.Event()
        self._is_wanted.set()
        self.is_asked = asyncio.Event()
        """Set once the first reply has come or failed."""

    def add(self, event: SelectionEvent) -> None:
        """Store an event that the cache has."""
        self._received.append(_identity(event))

    def set_service(self, instance: str, *, present: bool) -> None:
        """Query a selector that has started."""
        if present and instance.partition(".")[0] == SELECTOR:
            self._is_wanted.set()

    async def run(self) -> None:
        """Query now, and each selector that starts."""
        while True:
            await self._is_wanted.wait()
            await self.ask()

    async def ask(self) -> None:
        """Query once. Without a reply the cache stays as it is."""
        self._is_wanted.clear()
        now_ns = self._clock.now_ns()
        query = ReadHistory(last=HISTORY, since_ns=max(0, now_ns - BACK_NS))
        try:
            reply = await self._bus.call(READ_HISTORY, query, timeout_s=QUERY_TIMEOUT_S)
        except NoAnswerError:
            return  # it is queried when it starts
        except PointItError as error:
            log.info("pages do not show what happened before they came: %s", error)
            return
        finally:
            self.is_asked.set()
        # Only events that this server has not received itself
        received = set(self._received)
        past: list[tuple[int, Change]] = []
        for event in reply.events:
            if event.stamp_ns > now_ns + AHEAD_NS or _identity(event) in received:
                continue
            past.append((event.stamp_ns, (SELECTION_EVENTS.key, "", encode(event))))
        self._cache.recall(past)


def _identity(event: SelectionEvent) -> Identity:
    """Return the fields that repeated messages of one event share; their reasons may differ."""
    return event.stamp_ns, event.seq, event.event, event.object_id
