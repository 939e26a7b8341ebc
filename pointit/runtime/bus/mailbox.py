"""Bounded buffers between arrival and handling, and the wake-up of the loop that drains them.

Items may arrive on any thread. They are conflated or queued before decoding, and handled in the event loop.
"""

import asyncio
import collections
import logging
import math
import threading
from collections.abc import Callable, Collection, Iterable
from typing import Any, Protocol

from pointit.runtime.bus.contract import EVENT_CAPACITY, AnyTopic, SubscriptionStats
from pointit.runtime.errors import describe
from pointit.runtime.machine import this_machine
from pointit.schemas import DecodeError, Message
from pointit.schemas.topics import Delivery

log = logging.getLogger(__name__)

MAX_ROUNDS = 16
"""Maximum number of hops in a chain per wake-up. Then other tasks of the loop run."""
LOG_PERIOD_S = 1.0
"""Minimum interval of log lines per topic and kind of problem, and per failing handler, s."""


class Drainable(Protocol):
    """A buffer that any thread fills and the loop drains, such as `Mailbox`."""

    def drain(self) -> None:
        """Handle all queued items."""
        ...


class Dispatcher:
    """Drains scheduled mailboxes in its event loop, with one wake-up for all of them."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.thread = threading.get_ident()
        """Id of the loop's thread."""
        self.ready: collections.deque[Drainable] = collections.deque()
        """Buffers to drain. A caller that adds one must then call `wake`, unless the loop `is_awake`."""
        self.is_awake = False
        """True if the loop will check `ready` before it sleeps."""
        self.is_closed = False
        self._monotonic_s = this_machine().monotonic_s
        self._log_lock = threading.Lock()
        self._logged_s: dict[tuple[str, str], float] = {}

    def should_log(self, key: str, problem: str) -> bool:
        """Return True if a log line on `problem` about the topic `key` is due. Any thread."""
        now_s = self._monotonic_s()
        with self._log_lock:
            logged_s = self._logged_s.get((key, problem), -math.inf)
            if now_s - logged_s < LOG_PERIOD_S:
                return False
            self._logged_s[key, problem] = now_s
            return True

    def schedule(self, mailbox: Drainable) -> None:
        """Schedule `mailbox` to be drained. Any thread."""
        self.ready.append(mailbox)
        if not self.is_awake:
            self.wake()

    def wake(self) -> None:
        """Wake the loop to check `ready`. Any thread."""
        self.is_awake = True
        is_loop_thread = threading.get_ident() == self.thread
        try:
            if is_loop_thread:
                self._loop.call_soon(self._drain_all)
            else:
                self._loop.call_soon_threadsafe(self._drain_all)
        except RuntimeError:  # the loop is closed: this is a late callback of another thread
            self.is_closed = True

    def close(self) -> None:
        """Stop draining."""
        self.is_closed = True
        self.ready.clear()

    def _drain_all(self) -> None:
        ready = self.ready
        try:
            # Rounds are counted down: that is cheaper than a `range` for each
            rounds = MAX_ROUNDS
            remaining = len(ready)
            while ready and not self.is_closed:
                if not remaining:
                    rounds -= 1
                    remaining = len(ready)
                    if not rounds:
                        break
                remaining -= 1
                ready.popleft().drain()
        finally:
            # A thread that added a buffer since the last check saw `is_awake`: check again.
            self.is_awake = False
            if ready and not self.is_closed:
                self.wake()


class Mailbox:
    """Buffer between the network and one reader: the newest item per name, or the newest events in order.

    Messages arrive in threads of the network library and at any rate; a handler runs in the event loop, one
    message at a time. The mailbox is where they meet. Of a topic of newest values it keeps the last one of
    each name, so a reader that is slow sees fewer values, and no old ones. Of events it keeps
    `EVENT_CAPACITY` in order and counts those that it had to drop.

    Items from the loop's own thread, which are most of a process's traffic, need no lock: no other thread
    reads their buffer. Items from other threads go into a second buffer under the lock.

    - No wake-up is lost: the first item in either buffer schedules the mailbox, and `drain` empties both. The
      lock makes storing and counting in the second buffer one step, and emptying another.
    - No item overtakes another: all items in the first buffer are older than those in the second, since the
      loop's thread uses the second while it is not empty. `drain` handles them in this order.
    - No count is lost: each counter is changed by one thread only, or under the lock.
    """

    def __init__(
        self,
        topic: AnyTopic,
        handler: Callable[[Any, str], None],
        dispatcher: Dispatcher,
        unpack: Callable[[Any], Message] | None = None,
        *,
        retained: bool = True,
        queue_all: bool = False,
    ) -> None:
        """Create a buffer for `topic`. `handler` gets its messages in the loop of `dispatcher`.

        `unpack` decodes items of other processes in the loop. `retained`: accept retained states, whose
        writers may be gone. `queue_all`: queue all messages like events, instead of the newest only.
        """
        self.topic = topic
        self.traffic = SubscriptionStats()
        # Bound methods and ids are stored, since `put` runs for each sample
        self._handler: Callable[[Any, str], None] = handler
        self._dispatcher = dispatcher
        self._make_ready = dispatcher.ready.append
        self._thread = dispatcher.thread
        self._unpack = unpack
        self._lock = threading.Lock()
        self._closed = False
        self._keeps_newest = topic.delivery is not Delivery.EVENT and not queue_all
        self._newest_here: dict[str, Message] = {}
        self._queue_here: collections.deque[tuple[str, Message]] = collections.deque(maxlen=EVENT_CAPACITY)
        self._newest: dict[str, Any] = {}
        self._queue: collections.deque[tuple[str, Any]] = collections.deque(maxlen=EVENT_CAPACITY)
        self._arrived = 0
        """Number of items from other threads in these two since the last drain."""
        self._overflowed = 0
        """Number of overflows at the last report."""
        self._accepts_retained = retained and topic.delivery is Delivery.STATE
        self._looks = self._accepts_retained or not self._keeps_newest
        """True if items of this process are also filtered before they are handled."""
        self._live: set[str] = set()
        """Names for which a state of a living writer was handled."""
        self._recalled: dict[str, Message] = {}
        """Handled retained states by name, until a living writer puts a value."""
        self._retained: dict[str, Message] = {}
        """Retained states by name that are not handled yet."""

    @property
    def accepts_retained(self) -> bool:
        """Return True if `offer_retained` has an effect now."""
        return self._accepts_retained and not self._closed

    def put(self, name: str, message: Message) -> None:
        """Add `message` of this process. Never blocks, never raises. Meant for the loop's thread."""
        if self._arrived or threading.get_ident() != self._thread:
            self.offer(name, message)
            return
        if self._keeps_newest:
            newest = self._newest_here
            if not newest:  # `schedule`, without a call for each message
                self._make_ready(self)
                if not self._dispatcher.is_awake:
                    self._dispatcher.wake()
            elif name in newest:
                self._count_dropped(1)
            newest[name] = message
        else:
            queue = self._queue_here
            if not queue:
                self._dispatcher.schedule(self)
            elif len(queue) == EVENT_CAPACITY:
                self._count_dropped(1)
            queue.append((name, message))

    def offer(self, name: str, item: Any) -> None:
        """Add `item`, a message or an input of `unpack`. Any thread. Never blocks, never raises."""
        with self._lock:
            if self._closed:
                return
            if self._keeps_newest:
                self._newest[name] = item
            else:
                self._queue.append((name, item))
            self._arrived += 1
            if self._arrived > 1:
                return
        self._dispatcher.schedule(self)

    def offer_retained(self, name: str, message: Message) -> None:
        """Add a retained state. Called in the loop.

        The value of a living writer has precedence, whether it arrives before or after. Of two retained
        states, the one with the newer stamp and number is used.
        """
        if not self.accepts_retained or name in self._live:
            return
        current = self._retained.get(name) or self._recalled.get(name)
        if current is not None:
            is_newer = (message.stamp_ns, message.seq) > (current.stamp_ns, current.seq)
            if not is_newer:
                return
        with self._lock:
            self.traffic.received += 1
        if not self._retained:
            self._dispatcher.schedule(self)
        self._retained[name] = message

    def drain(self) -> None:
        """Handle all queued items. Called in the loop."""
        batch: Iterable[tuple[str, Any]]
        if self._arrived or self._looks:
            batch = self._decode_batch(self._fetch())
        else:
            newest = self._newest_here
            self._newest_here = {}
            self.traffic.received += len(newest)
            batch = newest.items()
        for name, message in batch:
            try:
                self._handler(message, name)
            except Exception as error:  # noqa: BLE001 - a message of one must not stop those of others
                self._count_error(error, name)
        if self._retained:
            self._drain_retained()

    def _fetch(self) -> Collection[tuple[str, Any]]:
        """Return all queued items: first those of the loop's thread, then those of other threads."""
        newest = self._newest_here
        queue = self._queue_here
        with self._lock:
            waiting = self._arrived + len(newest) + len(queue)
            self._arrived = 0
            newest.update(self._newest)
            self._newest.clear()
            queue.extend(self._queue)
            self._queue.clear()
        self._newest_here = {}
        self._queue_here = collections.deque(maxlen=EVENT_CAPACITY)
        batch = newest.items() if self._keeps_newest else queue
        self.traffic.received += len(batch)
        self._count_dropped(waiting - len(batch))
        return batch

    def _count_dropped(self, count: int) -> None:
        """Count replaced items and those that did not fit. Called in the loop."""
        self.traffic.received += count
        self.traffic.dropped += count

    def _decode_batch(self, batch: Iterable[tuple[str, Any]]) -> list[tuple[str, Message]]:
        """Return the decoded messages of `batch` that must be handled."""
        dropped = self.traffic.dropped
        has_lost_events = not self._keeps_newest and dropped > self._overflowed
        if has_lost_events and self._may_log("overflow"):
            self._overflowed = dropped
            log.warning("%s: reader too slow, %d events lost so far", self.topic.key, dropped)
        messages: list[tuple[str, Message]] = []
        for name, item in batch:
            message = item if isinstance(item, Message) else self._open(item, name)
            if message is None:
                continue
            if self._accepts_retained and self._is_known(name, message):
                continue
            messages.append((name, message))
        return messages

    def _is_known(self, name: str, message: Message) -> bool:
        """Record that a living writer has put `message`. Return True if it equals the retained value."""
        self._live.add(name)
        return bool(self._recalled) and self._recalled.pop(name, None) == message

    def _drain_retained(self) -> None:
        retained = self._retained
        self._retained = {}
        for name, message in retained.items():
            if self._closed:
                return
            if name not in self._live:
                self._recalled[name] = message
                try:
                    self._handler(message, name)
                except Exception as error:  # noqa: BLE001 - as above
                    self._count_error(error, name)

    def _count_error(self, error: Exception, name: str) -> None:
        """Count the `error` of the handler that was called with a message of `name`, and log it."""
        self.traffic.errors += 1
        self.traffic.last_failure = describe(error)
        self.traffic.last_failure_name = name
        if self._may_log(f"error {id(self)}"):
            sender = f" for {name}" if name else ""
            count = self.traffic.errors
            log.error("handler of %s failed%s (%d so far)", self.topic.key, sender, count, exc_info=error)

    def count_invalid(self, reason: object, name: str = "") -> None:
        """Count an invalid item, for `name` if known, and log the reason. Any thread."""
        with self._lock:
            self.traffic.invalid += 1
            self.traffic.last_error = str(reason)
            self.traffic.last_error_name = name
        if self._may_log("invalid"):
            log.warning("%s: dropped, %s (%d so far)", self.topic.key, reason, self.traffic.invalid)

    def count_lost(self, count: int) -> None:
        """Count events that were sent and never arrived. Any thread."""
        with self._lock:
            self.traffic.lost += count
        if self._may_log("lost"):
            log.warning("%s: %d events never arrived so far", self.topic.key, self.traffic.lost)

    def close(self) -> None:
        """Stop handling."""
        with self._lock:
            self._closed = True
        self._thread = 0  # makes `put` call `offer`, which accepts no item
        self._handler = lambda _message, _name: None  # items of a drain that is still running
        self._fetch()
        for rest in (self._live, self._recalled, self._retained):
            rest.clear()

    def _open(self, item: Any, name: str) -> Message | None:
        try:
            return self._unpack(item) if self._unpack else None
        except DecodeError as error:
            self.count_invalid(error, name)
        except Exception as error:  # noqa: BLE001 - no payload of another process may stop the loop
            self.count_invalid(f"{type(error).__name__}: {error}", name)
        return None

    def _may_log(self, problem: str) -> bool:
        return self._dispatcher.should_log(self.topic.key, problem)


class TapMailbox(Mailbox):
    """A mailbox without a buffer: each item goes to the handler on the thread on which it arrives."""

    def put(self, name: str, message: Message) -> None:
        """Deliver `message`. Any thread."""
        self.offer(name, message)

    def offer(self, name: str, item: Any) -> None:
        """Deliver `item`. Any thread."""
        if not self._closed:
            with self._lock:
                self.traffic.received += 1
            if self._accepts_retained:
                self._live.add(name)
            self._handler(item, name)

    def drain(self) -> None:
        """Deliver a retained state."""
        self._drain_retained()
