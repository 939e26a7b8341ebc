"""Asynchronous iterators over messages: the newest or every event, by the class of the topic."""

import asyncio
import collections
import contextlib
import itertools
import logging
import weakref
from collections.abc import AsyncIterator, Callable
from typing import Any, Generic, TypeVar

from pointit.runtime.bus.contract import EVENT_CAPACITY, Subscription, SubscriptionStats
from pointit.runtime.errors import VersionError
from pointit.schemas.topics import Delivery

log = logging.getLogger(__name__)

T = TypeVar("T")

U = TypeVar("U")

UNREADABLE_TIMEOUT_S = 1.0
"""Time without a readable message after which unreadable ones count as those of another version."""

MAX_INVALID_MESSAGES = 3
"""Number of unreadable messages that are tolerated before an error is raised."""


class ReceiveBuffer(Generic[U]):
    """Holds what came, by name, until it is taken. Use in the event loop only."""

    def __init__(self, delivery: Delivery, *, one_writer: bool = False) -> None:
        self._keeps_all = delivery is Delivery.EVENT
        self._has_one_writer = one_writer and not self._keeps_all
        self._max_invalid_messages = 0 if delivery is Delivery.STATE else MAX_INVALID_MESSAGES
        self._items: collections.OrderedDict[object, tuple[str, U]] = collections.OrderedDict()
        """Items with their names, by name, or by number if it keeps all."""
        self._numbers = itertools.count()
        self._changed = asyncio.Event()
        self._is_closed = False
        self._error: Exception | None = None
        self._overflowed = 0
        self._has_received = False
        self._has_warned = False
        self.source: Subscription | None = None
        """The subscription that fills it."""

    def __len__(self) -> int:
        return len(self._items)

    @property
    def lost(self) -> int:
        """Return the number of events that were not received or not taken in time."""
        if not self._keeps_all or self.source is None:
            return 0
        return self._overflowed + self.source.traffic.lost + self.source.traffic.dropped

    def put(self, item: U, name: str) -> None:
        """Add a message of `name`. It replaces a pending one of `name`, unless all are queued."""
        self._has_received = True
        self._items[next(self._numbers) if self._keeps_all else name] = (name, item)
        if self._keeps_all and len(self._items) > EVENT_CAPACITY:
            self._items.popitem(last=False)
            self._overflowed += 1
            if self._overflowed == 1:
                log.warning("events come faster than they are taken: the oldest ones are lost")
        self._changed.set()

    def close(self, error: Exception | None = None) -> None:
        """Stop adding. Readers get the pending messages, then `error` or the end."""
        if not self._is_closed:
            self._is_closed, self._error = True, error
            self._changed.set()
            if self.source is not None:
                self.source.close()

    async def take(self) -> tuple[str, U]:
        """Return the oldest pending message, or wait for one.

        Raises:
            StopAsyncIteration: If the feed has ended.
            PointItError: If the feed ended with this error.
        """
        while not self._items:
            if self._is_closed:
                raise self._error or StopAsyncIteration
            self._changed.clear()
            await self._wait()
        return self._items.popitem(last=False)[1]

    async def _wait(self) -> None:
        if self._has_received or self.source is None:
            await self._changed.wait()
            return
        try:
            async with asyncio.timeout(UNREADABLE_TIMEOUT_S):
                await self._changed.wait()
        except TimeoutError:
            if self.source.traffic.invalid > self._max_invalid_messages:
                self._report_unreadable(self.source.traffic)

    def _report_unreadable(self, stats: SubscriptionStats) -> None:
        if self._has_one_writer:
            self.close(VersionError(unreadable(stats)))
        elif not self._has_warned:  # others may write what can be read
            self._has_warned = True
            log.warning("%s", unreadable(stats))


def unreadable(stats: SubscriptionStats) -> str:
    """Return a message on a reader that gets only what it cannot read."""
    return (
        f"{stats.invalid} messages came and none could be read ({stats.last_error}); "
        "install the same version of PointIt here and on the site"
    )


class Feed(AsyncIterator[T], Generic[T]):
    """The messages of a topic from the call that made it on, one per step of `async for`.

    A slow loop gets the newest of each name, or of events every one, up to 1024 that wait. The loop ends when
    the site is closed, and goes on after a lost connection is back.

    Raises, in the loop:
        AccessDeniedError: If this identity may not read it.
        VersionError: If what arrives cannot be read, where one name writes all and not only events. Elsewhere
            a warning is logged and the loop goes on.
    """

    def __init__(
        self,
        buffer: ReceiveBuffer[Any],
        pick: Callable[[tuple[str, Any]], T],
        speed: Callable[[], float],
        duration_s: float | None = None,
    ) -> None:
        self._buffer = buffer
        self._pick = pick
        self._speed = speed
        self._duration_s = duration_s
        self._end_s: float | None = None
        self._left: int | None = None
        """Items to give after the end of the duration."""

    @property
    def lost(self) -> int:
        """Return the number of events that were lost on the way, or because the loop was too slow."""
        return self._buffer.lost

    def items(self) -> "Feed[tuple[str, T]]":
        """Return the same with the name of each item: the person, tracker, service or lamp."""
        pick = self._pick
        return Feed(self._buffer, lambda pair: (pair[0], pick(pair)), self._speed, self._duration_s)

    def during(self, seconds: float) -> "Feed[T]":
        """Return this feed with an end `seconds` of the site's time after the first step.

        `during(0)` yields only messages that have already arrived.
        """
        return Feed(self._buffer, self._pick, self._speed, seconds)

    def close(self) -> None:
        """Receive nothing more. Unnecessary where the site is closed, or nothing refers to it any more."""
        self._buffer.close()

    async def __anext__(self) -> T:
        now_s = asyncio.get_running_loop().time()
        if self._end_s is None and self._duration_s is not None:
            self._end_s = now_s + self._duration_s / self._speed()
        if self._end_s is None or now_s < self._end_s:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(self._end_s):
                    return self._pick(await self._buffer.take())
        if self._left is None:
            self._left = len(self._buffer)
        if not self._left or not len(self._buffer):
            raise StopAsyncIteration
        self._left -= 1
        return self._pick(await self._buffer.take())


class PresentNames:
    """The names that are present, and those who follow them."""

    def __init__(self) -> None:
        self.names = frozenset[str]()
        self._gone = set[str]()
        self.buffers = weakref.WeakSet[ReceiveBuffer[frozenset[str]]]()

    def on_change(self, name: str, is_there: bool) -> None:  # noqa: FBT001 - the bus's signature
        """Record that `name` has arrived or left, and publish the present names."""
        (self._gone.discard if is_there else self._gone.add)(name)
        names = self.names | {name} if is_there else self.names - {name}
        if names != self.names:
            self.names = names
            for buffer in self.buffers:
                buffer.put(names, "")

    def merge(self, listed: set[str]) -> None:
        """Add who was listed while changes already came, except those who left meanwhile."""
        self.names |= listed - self._gone
