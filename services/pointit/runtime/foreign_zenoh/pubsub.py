# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Writers and readers of a plain session; Zenoh's threads only fill queues here."""

import collections
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zenoh
from zenoh import ext

from pointit.runtime.bus.dispatcher import Dispatcher
from pointit.runtime.errors import BusClosedError
from pointit.runtime.zenoh.declarations import (
    Declaration,
    declare_caching_subscriber,
    declare_publisher,
    declare_subscriber,
)

log = logging.getLogger(__name__)

HEARTBEAT_S = 0.5
"""Period (s) after which a reader notices that it lost the last message of a reliable, caching writer."""
MAX_ATTACHMENT_BYTES = 4096
"""Messages with a longer attachment are dropped."""


@dataclass(frozen=True, slots=True)
class RawSample:
    """A received sample."""

    key: str
    payload: bytes
    attachment: bytes | None


@dataclass
class PlainTraffic:
    """Counters of a reader, updated on any thread."""

    received: int = 0
    overrun: int = 0
    """Dropped because the loop was busy."""
    oversized: int = 0
    """Dropped because they were too long."""
    errors: int = 0
    """Handlers that failed."""


def bytes_of(data: zenoh.ZBytes | None) -> bytes | None:
    """Return the content of a payload or attachment."""
    return None if data is None else data.to_bytes()


def is_oversized(payload: zenoh.ZBytes | None, attachment: zenoh.ZBytes | None, max_bytes: int) -> bool:
    """Return True if a message is longer than anything that is taken; its bytes are not copied."""
    return (payload is not None and len(payload) > max_bytes) or (
        attachment is not None and len(attachment) > MAX_ATTACHMENT_BYTES
    )


class RawPublisher(Declaration):
    """Writes one key."""

    def __init__(self, session: zenoh.Session, key: str, kept: int, reliable: bool) -> None:  # noqa: FBT001
        missed = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S) if reliable else None
        self._writer = declare_publisher(session, key, cache=kept, missed=missed)
        super().__init__(self._writer)

    @property
    def is_read(self) -> bool:
        """Return True if Zenoh knows a reader in another session; a writer that keeps messages does not."""
        if self.is_closed or not isinstance(self._writer, zenoh.Publisher):
            return False
        status: Any = self._writer.matching_status  # no bool, whatever the stubs say: always true
        return bool(status.matching)

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        """Send; returns at once.

        Raises:
            BusClosedError: this writer or its session is closed.
        """
        try:
            self._writer.put(payload, attachment=attachment)
        except zenoh.ZError as error:
            raise BusClosedError("the writer or its session was closed") from error


class RawSubscriber(Declaration):
    """Reads one key: a queue between Zenoh's threads and the loop. See `RawSession.subscriber`."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        dispatcher: Dispatcher,
        handler: Callable[[RawSample], None],
        *,
        on_loss: Callable[[PlainTraffic], None] | None,
        capacity: int,
        max_bytes: int,
        kept: int,
        reliable: bool,
    ) -> None:
        self.traffic = PlainTraffic()
        self._key = key
        self._dispatcher = dispatcher
        self._handler = handler
        self._on_loss = on_loss
        self._lost = 0
        """Number of dropped messages at the last report."""
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._queue: collections.deque[zenoh.Sample] = collections.deque(maxlen=capacity)
        self._marked = False
        super().__init__(
            declare_caching_subscriber(
                session, key, self._on_sample, history=kept, recovers=reliable, is_announced=True
            )
            if kept
            else declare_subscriber(session, key, self._on_sample)
        )

    def _on_sample(self, sample: zenoh.Sample) -> None:  # on Zenoh's threads
        if sample.kind != zenoh.SampleKind.PUT:
            return
        with self._lock:
            self.traffic.received += 1
            if is_oversized(sample.payload, sample.attachment, self._max_bytes):
                self.traffic.oversized += 1
            else:
                self.traffic.overrun += len(self._queue) == self._queue.maxlen
                self._queue.append(sample)
            if self._marked:
                return
            self._marked = True
        self._dispatcher.schedule(self)

    def drain(self) -> None:
        """Handle the waiting messages. Runs in the loop."""
        with self._lock:
            waiting = tuple(self._queue)
            self._queue.clear()
            self._marked = False
            lost = self.traffic.oversized + self.traffic.overrun
        if lost != self._lost and self._on_loss is not None and not self.is_closed:
            self._lost = lost
            self._on_loss(self.traffic)
        for sample in waiting:
            if self.is_closed or self._dispatcher.is_closed:
                return
            packet = RawSample(str(sample.key_expr), sample.payload.to_bytes(), bytes_of(sample.attachment))
            try:
                self._handler(packet)
            except Exception:
                self.traffic.errors += 1
                if self._dispatcher.should_log(self._key, "error"):
                    log.exception("what arrived at %s could not be handled", packet.key)
