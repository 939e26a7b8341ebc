"""What happened before this server came: asked of the selector, whose journal has it."""

import asyncio
import logging
from collections import deque

from pointit.bridges.web.pages.latest_values import HISTORY, MOST_EVENTS, LatestValueCache
from pointit.runtime.clock import Clock
from pointit.runtime.errors import NoAnswerError, PointItError
from pointit.runtime.health.service_bus import ServiceBus
from pointit.schemas import NS_PER_S, ReadHistory, SchemaError, SelectionEvent, encode
from pointit.schemas.topics import READ_HISTORY, SELECTION_EVENTS

log = logging.getLogger(__name__)

SELECTOR = "selector"

BACK_NS = 86_400 * NS_PER_S
"""So far it is asked: messages have a time of day, no date."""

AHEAD_NS = 60 * NS_PER_S
"""Further ahead are events of another run, whose time was simulated; no two clocks are so far apart."""

PATIENCE_S = 1.0
"""How long the answer may take: pages wait for the first one."""

Identity = tuple[int, int, str, str]


class Past:
    """Gives a hub the events that it has not heard itself."""

    def __init__(self, bus: ServiceBus, clock: Clock, hub: LatestValueCache) -> None:
        """Ask nobody yet."""
        self._bus = bus
        self._clock = clock
        self._hub = hub
        self._heard: deque[Identity] = deque(maxlen=MOST_EVENTS)
        self._is_wanted = asyncio.Event()
        self._is_wanted.set()
        self.is_asked = asyncio.Event()
        """Set once the first answer has come, or is not to be had."""
        self._has_complained = False

    def hear(self, event: SelectionEvent) -> None:
        """Take note of an event that the hub has."""
        self._heard.append(_identity(event))

    def set_service(self, instance: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        """Have the selector asked that has come."""
        if present and instance.partition(".")[0] == SELECTOR:
            self._is_wanted.set()

    async def run(self) -> None:
        """Ask now, and each selector that comes."""
        while True:
            await self._is_wanted.wait()
            await self.ask()

    async def ask(self) -> None:
        """Ask once; without an answer the hub stays as it is."""
        try:
            await self._ask()
        finally:
            self.is_asked.set()

    async def _ask(self) -> None:
        self._is_wanted.clear()
        now_ns = self._clock.now_ns()
        query = ReadHistory(last=HISTORY, since_ns=max(0, now_ns - BACK_NS))
        try:
            reply = await self._bus.call(READ_HISTORY, query, timeout_s=PATIENCE_S)
        except NoAnswerError:
            return  # it is asked when it comes
        except (PointItError, SchemaError) as error:
            if not self._has_complained:
                log.info("pages do not show what happened before they came: %s", error)
            self._has_complained = True
            return
        heard = set(self._heard)
        self._hub.recall(
            (event.stamp_ns, (SELECTION_EVENTS.key, "", encode(event)))
            for event in reply.events
            if event.stamp_ns <= now_ns + AHEAD_NS and _identity(event) not in heard
        )


def _identity(event: SelectionEvent) -> Identity:
    """Return what two tellings of one event have in common; a reason may say that it is told again."""
    return event.stamp_ns, event.seq, event.event, event.object_id
