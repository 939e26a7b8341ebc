"""Between arrival and handling: buffers that never grow, and the one wake-up that drains them.

Items may arrive on any thread; they are conflated or queued before anything is decoded, and handled in
the event loop. A chain of services on one loop is drained in one wake-up.
"""

import asyncio
import collections
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from pointit.runtime.bus.contract import EVENT_CAPACITY, AnyTopic, SubscriptionStats, Tap
from pointit.schemas import DecodeError, Message
from pointit.schemas.topics import Delivery

log = logging.getLogger(__name__)

MAX_ROUNDS = 16
"""Hops of a chain handled in one wake-up before other tasks of the loop get their turn."""
LOG_PERIOD_S = 1.0
"""At most one log line per topic and kind of trouble in this time; one per handler that fails."""


class Drainable(Protocol):
    """A buffer that is filled on any thread and drained in the loop, such as `Mailbox`."""

    def drain(self) -> None:
        """Handle what is there."""
        ...


class Dispatcher:
    """Drains marked mailboxes in its event loop, with one wake-up for all of them."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        self._ready: collections.deque[Drainable] = collections.deque()
        self._awake = False
        self._closed = False
        self._log_lock = threading.Lock()
        self._logged_s: dict[tuple[str, str], float] = {}

    @property
    def is_closed(self) -> bool:
        """Return True if nothing is drained any more."""
        return self._closed

    def should_log(self, key: str, what: str) -> bool:
        """Return True if a log line on `what` about the topic `key` is due. Any thread."""
        now_s = time.monotonic()
        with self._log_lock:
            if now_s - self._logged_s.get((key, what), -math.inf) < LOG_PERIOD_S:
                return False
            self._logged_s[key, what] = now_s
            return True

    def schedule(self, mailbox: Drainable) -> None:
        """Have `mailbox` drained soon; from any thread."""
        self._ready.append(mailbox)
        if not self._awake:
            self._awake = True
            self._schedule()

    def close(self) -> None:
        """Drain nothing any more."""
        self._closed = True
        self._ready.clear()

    def _schedule(self) -> None:
        if threading.get_ident() == self._thread:
            self._loop.call_soon(self._wake)
            return
        try:
            self._loop.call_soon_threadsafe(self._wake)
        except RuntimeError:  # the loop is closed: a late callback of a foreign thread
            self._closed = True

    def _wake(self) -> None:
        ready = self._ready
        try:
            for _ in range(MAX_ROUNDS):
                if not ready:
                    break
                for _ in range(len(ready)):
                    if self._closed:
                        return
                    ready.popleft().drain()
        finally:
            # A thread that marked between the last look and this line saw us awake: look again afterwards.
            self._awake = False
            if self._ready and not self._closed:
                self._awake = True
                self._schedule()


class Mailbox:
    """One subscription's buffer: the newest per name, or for events the newest `EVENT_CAPACITY` in order."""

    def __init__(
        self,
        topic: AnyTopic,
        handler: Callable[[Any, str], None],
        dispatcher: Dispatcher,
        unpack: Callable[[Any], Message] | None = None,
        *,
        kept: bool = True,
        every: bool = False,
    ) -> None:
        """Make a buffer for `topic`, whose messages `handler` takes in the loop of `dispatcher`.

        `unpack` turns foreign items into messages, in the loop. `kept`: take what was kept of a state whose
        writer may be gone. `every`: queue what is not an event like one, rather than keep the newest.
        """
        self.topic = topic
        self.traffic = SubscriptionStats()
        self._handler = handler
        self._dispatcher = dispatcher
        self._unpack = unpack
        self._lock = threading.Lock()
        self._marked = False
        self._closed = False
        self._keeps_newest = topic.delivery is not Delivery.EVENT and not every
        self._newest: dict[str, Any] = {}
        self._queue: collections.deque[tuple[str, Any]] = collections.deque(maxlen=EVENT_CAPACITY)
        self._overflowed = 0
        """Number of overflows at the last report."""
        self._takes_kept = kept and topic.delivery is Delivery.STATE
        self._live: set[str] = set()
        """Names of which a living writer's state was handled."""
        self._recalled: dict[str, Message] = {}
        """By name: what was kept and is handled, till a living writer says something."""
        self._kept: dict[str, Message] = {}
        """By name: what was kept and is not handled yet."""

    @property
    def accepts_retained(self) -> bool:
        """Return True if `offer_retained` has an effect now."""
        return self._takes_kept and not self._closed

    def offer(self, name: str, item: Any) -> None:
        """Take `item`; from any thread, never blocks, never raises."""
        if self._closed:
            return
        with self._lock:
            traffic = self.traffic
            traffic.received += 1
            if self._keeps_newest:
                newest = self._newest
                if name in newest:
                    traffic.dropped += 1
                newest[name] = item
            else:
                if len(self._queue) == EVENT_CAPACITY:
                    traffic.dropped += 1
                self._queue.append((name, item))
            if self._marked:
                return
            self._marked = True
        self._dispatcher.schedule(self)

    def offer_retained(self, name: str, message: Message) -> None:
        """Take what somebody has kept of a state; in the loop.

        What a living writer puts wins, whether it comes before or after; of what is kept, the newer by
        stamp and number.
        """
        if not self.accepts_retained or name in self._live:
            return
        known = self._kept.get(name) or self._recalled.get(name)
        if known is not None and (message.stamp_ns, message.seq) <= (known.stamp_ns, known.seq):
            return
        with self._lock:
            self.traffic.received += 1
            self._kept[name] = message
            if self._marked:
                return
            self._marked = True
        self._dispatcher.schedule(self)

    def drain(self) -> None:
        """Handle everything that is there; in the loop."""
        with self._lock:
            self._marked = False
            batch: Iterable[tuple[str, Any]]
            if self._keeps_newest:
                newest, self._newest = self._newest, {}
                batch = newest.items()
            else:
                batch = list(self._queue)
                self._queue.clear()
            dropped = self.traffic.dropped
        if not self._keeps_newest and dropped > self._overflowed and self._may_log("overflow"):
            self._overflowed = dropped
            log.warning("%s: reader too slow, %d events lost so far", self.topic.key, dropped)
        for name, item in batch:
            if self._closed:
                return
            message = item if isinstance(item, Message) else self._open(item, name)
            if message is None or (self._takes_kept and self._is_known(name, message)):
                continue
            try:
                self._handler(message, name)
            except Exception as error:  # noqa: BLE001 - a handler's fault must not stop the others
                self._count_error(error)
        if self._kept:
            self._drain_kept()

    def _is_known(self, name: str, message: Message) -> bool:
        """Note that a living writer has put `message`. Return True if it equals the retained value."""
        self._live.add(name)
        return bool(self._recalled) and self._recalled.pop(name, None) == message

    def _drain_kept(self) -> None:
        kept, self._kept = self._kept, {}
        for name, message in kept.items():
            if self._closed:
                return
            if name not in self._live:
                self._recalled[name] = message
                try:
                    self._handler(message, name)
                except Exception as error:  # noqa: BLE001 - as above
                    self._count_error(error)

    def _count_error(self, error: Exception) -> None:
        self.traffic.errors += 1
        if self._may_log(f"error {id(self)}"):
            count = self.traffic.errors
            log.error("handler of %s failed (%d so far)", self.topic.key, count, exc_info=error)

    def count_invalid(self, reason: object, name: str = "") -> None:
        """Count what came, for `name` if known, and cannot be taken, and say why; from any thread."""
        with self._lock:
            self.traffic.invalid += 1
            self.traffic.complaint, self.traffic.culprit = str(reason), name
        if self._may_log("invalid"):
            log.warning("%s: dropped, %s (%d so far)", self.topic.key, reason, self.traffic.invalid)

    def count_lost(self, count: int) -> None:
        """Count events that were sent and never came; from any thread."""
        with self._lock:
            self.traffic.lost += count
        if self._may_log("lost"):
            log.warning("%s: %d events never arrived so far", self.topic.key, self.traffic.lost)

    def close(self) -> None:
        """Handle nothing any more."""
        self._closed = True
        with self._lock:
            self._newest.clear()
            self._queue.clear()
        for names in (self._live, self._recalled, self._kept):
            names.clear()

    def _open(self, item: Any, name: str) -> Message | None:
        try:
            return self._unpack(item) if self._unpack else None
        except DecodeError as error:
            self.count_invalid(error, name)
        except Exception as error:  # noqa: BLE001 - whatever foreign bytes provoke, they stop nobody
            self.count_invalid(f"{type(error).__name__}: {error}", name)
        return None

    def _may_log(self, what: str) -> bool:
        return self._dispatcher.should_log(self.topic.key, what)


class TapMailbox(Mailbox):
    """A mailbox that keeps nothing: what arrives goes to the handler, on the thread on which it arrives."""

    def __init__(self, topic: AnyTopic, handler: Tap, dispatcher: Dispatcher) -> None:
        super().__init__(topic, handler, dispatcher)

    def offer(self, name: str, item: Any) -> None:
        """Hand over `item`; from any thread."""
        if not self._closed:
            self.traffic.received += 1
            if self._takes_kept:
                self._live.add(name)
            self._handler(item, name)

    def drain(self) -> None:
        """Hand over what was kept of states."""
        with self._lock:
            self._marked = False
        self._drain_kept()
