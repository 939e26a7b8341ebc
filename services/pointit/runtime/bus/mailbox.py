"""Between arrival and handling: buffers that never grow.

Items may arrive on any thread; they are conflated or queued before anything is decoded, and handled in
the event loop.
"""

import collections
import logging
import threading
from collections.abc import Callable, Collection, Iterable
from typing import Any

from pointit.runtime.bus.contract import EVENT_CAPACITY, AnyTopic, SubscriptionStats
from pointit.runtime.bus.dispatcher import Dispatcher
from pointit.schemas import DecodeError, Message
from pointit.schemas.topics import Delivery

log = logging.getLogger(__name__)


class Mailbox:
    """One subscription's buffer: the newest per name, or for events the newest `EVENT_CAPACITY` in order.

    What is put in the loop's own thread, which is most of the traffic of a process, takes no lock: it waits
    where no other thread looks. What other threads bring waits in a buffer of its own, under the lock.

    - No wake-up is lost: who puts the first item into one of the two buffers schedules the mailbox, and
      `drain` empties both. For the second, the lock makes storing and counting one step, as well as emptying.
    - Nothing overtakes: whatever waits in the first is older than all in the second, since the loop's thread
      adds to the second while something is there. `drain` handles them in this order.
    - No count is lost: each is changed by one thread only, or under the lock.
    """

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
        self._make_ready = dispatcher.ready.append
        self._thread = dispatcher.thread
        self._unpack = unpack
        self._lock = threading.Lock()
        self._closed = False
        self._keeps_newest = topic.delivery is not Delivery.EVENT and not every
        self._newest_here: dict[str, Message] = {}
        self._queue_here: collections.deque[tuple[str, Message]] = collections.deque(maxlen=EVENT_CAPACITY)
        self._newest: dict[str, Any] = {}
        self._queue: collections.deque[tuple[str, Any]] = collections.deque(maxlen=EVENT_CAPACITY)
        self._arrived = 0
        """Number of items that other threads brought into these two since they were drained."""
        self._overflowed = 0
        """Number of overflows at the last report."""
        self._takes_kept = kept and topic.delivery is Delivery.STATE
        self._looks = self._takes_kept or not self._keeps_newest
        """True if what was put here is looked through before it is handled, too."""
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

    def put(self, name: str, message: Message) -> None:
        """Take `message` of this process; never blocks, never raises. Meant for the loop's thread."""
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
        """Take `item`, a message or what `unpack` turns into one; any thread, never blocks, never raises."""
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
        if not self._kept:
            self._dispatcher.schedule(self)
        self._kept[name] = message

    def drain(self) -> None:
        """Handle everything that is there; in the loop."""
        batch: Iterable[tuple[str, Any]]
        if self._arrived or self._looks:
            batch = self._look_through(self._fetch())
        else:
            newest, self._newest_here = self._newest_here, {}
            self.traffic.received += len(newest)
            batch = newest.items()
        for name, message in batch:
            if self._closed:
                return
            try:
                self._handler(message, name)
            except Exception as error:  # noqa: BLE001 - a handler's fault must not stop the others
                self._count_error(error)
        if self._kept:
            self._drain_kept()

    def _fetch(self) -> Collection[tuple[str, Any]]:
        """Return all that waits: what was put here, and behind it what other threads brought."""
        newest, queue = self._newest_here, self._queue_here
        with self._lock:
            waiting, self._arrived = self._arrived + len(newest) + len(queue), 0
            newest.update(self._newest)
            self._newest.clear()
            queue.extend(self._queue)
            self._queue.clear()
        self._newest_here, self._queue_here = {}, collections.deque(maxlen=EVENT_CAPACITY)
        batch = newest.items() if self._keeps_newest else queue
        self.traffic.received += len(batch)
        self._count_dropped(waiting - len(batch))
        return batch

    def _count_dropped(self, count: int) -> None:
        """Count what was replaced or did not fit; in the loop."""
        self.traffic.received += count
        self.traffic.dropped += count

    def _look_through(self, batch: Iterable[tuple[str, Any]]) -> list[tuple[str, Message]]:
        """Return the messages of `batch` that are to be handled, unpacked."""
        dropped = self.traffic.dropped
        if not self._keeps_newest and dropped > self._overflowed and self._may_log("overflow"):
            self._overflowed = dropped
            log.warning("%s: reader too slow, %d events lost so far", self.topic.key, dropped)
        messages: list[tuple[str, Message]] = []
        for name, item in batch:
            message = item if isinstance(item, Message) else self._open(item, name)
            if message is not None and not (self._takes_kept and self._is_known(name, message)):
                messages.append((name, message))
        return messages

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
        with self._lock:
            self._closed = True
        self._thread = 0  # sends `put` to `offer`, which takes nothing
        self._fetch()
        for rest in (self._live, self._recalled, self._kept):
            rest.clear()

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

    def put(self, name: str, message: Message) -> None:
        """Hand over `message`; from any thread."""
        self.offer(name, message)

    def offer(self, name: str, item: Any) -> None:
        """Hand over `item`; from any thread."""
        if not self._closed:
            with self._lock:
                self.traffic.received += 1
            if self._takes_kept:
                self._live.add(name)
            self._handler(item, name)

    def drain(self) -> None:
        """Hand over what was kept of states."""
        self._drain_kept()
