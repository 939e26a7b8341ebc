# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Writers and readers of a plain session; Zenoh's threads only fill queues here."""

import collections
import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zenoh
from zenoh import ext

from pointit.runtime.bus.mailbox import LOG_PERIOD_S, Dispatcher
from pointit.runtime.errors import BusClosedError
from pointit.runtime.transport.declarations import (
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


class RawPublisher:
    """Writes one key."""

    def __init__(self, session: zenoh.Session, key: str, kept: int, reliable: bool) -> None:  # noqa: FBT001
        missed = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S) if reliable else None
        self._writer = declare_publisher(session, key, cache=kept, missed=missed)
        self._closed = False

    @property
    def is_read(self) -> bool:
        """Return True if Zenoh knows a reader in another session; a writer that keeps messages does not."""
        if self._closed or not isinstance(self._writer, zenoh.Publisher):
            return False
        status: Any = self._writer.matching_status  # no bool, whatever the stubs say: always true
        return bool(status.matching)

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        """Send; returns at once.

        Raises:
            BusClosedError: this writer or its session is closed.
        """
        if self._closed:
            raise BusClosedError("the writer was closed")
        try:
            self._writer.put(payload, attachment=attachment)
        except zenoh.ZError as error:
            raise BusClosedError("the session was closed") from error

    def close(self) -> None:
        """Close the publisher and its cache."""
        if not self._closed:
            self._closed = True
            self._writer.undeclare()


class RawSubscriber:
    """Reads one key: a queue between Zenoh's threads and the loop."""

    def __init__(
        self,
        dispatcher: Dispatcher,
        handler: Callable[[RawSample], None],
        *,
        on_loss: Callable[[PlainTraffic], None] | None,
        capacity: int,
        max_bytes: int,
        on_close: Callable[["RawSubscriber"], None],
    ) -> None:
        self.traffic = PlainTraffic()
        self._dispatcher = dispatcher
        self._handler = handler
        self._on_loss = on_loss
        self._lost = 0
        """Number of dropped messages at the last report."""
        self._max_bytes = max_bytes
        self._on_close = on_close
        self._lock = threading.Lock()
        self._queue: collections.deque[zenoh.Sample] = collections.deque(maxlen=capacity)
        self._marked = False
        self._closed = False
        self._logged_s = -math.inf
        self._undeclare: Callable[[], None] = lambda: None

    def declare(self, session: zenoh.Session, key: str, kept: int, reliable: bool) -> None:  # noqa: FBT001
        """Begin to read `key`."""
        declared = (
            declare_caching_subscriber(
                session, key, self._on_sample, history=kept, recovers=reliable, is_announced=True
            )
            if kept
            else declare_subscriber(session, key, self._on_sample)
        )
        self._undeclare = declared.undeclare

    def close(self) -> None:
        """Read no more; no handler runs afterwards."""
        if not self._closed:
            self.stop()
            self._undeclare()
            self._on_close(self)

    def stop(self) -> None:
        """Handle nothing any more."""
        self._closed = True
        self._queue.clear()

    def _on_sample(self, sample: zenoh.Sample) -> None:  # on Zenoh's threads
        if self._closed or sample.kind != zenoh.SampleKind.PUT:
            return
        attachment = sample.attachment
        attached = 0 if attachment is None else len(attachment)
        with self._lock:
            self.traffic.received += 1
            if len(sample.payload) > self._max_bytes or attached > MAX_ATTACHMENT_BYTES:
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
        if lost != self._lost and self._on_loss is not None and not self._closed:
            self._lost = lost
            self._on_loss(self.traffic)
        for sample in waiting:
            if self._closed:
                return
            attachment = sample.attachment
            packet = RawSample(
                str(sample.key_expr),
                sample.payload.to_bytes(),
                None if attachment is None else attachment.to_bytes(),
            )
            try:
                self._handler(packet)
            except Exception:
                self.traffic.errors += 1
                now_s = time.monotonic()
                if now_s - self._logged_s >= LOG_PERIOD_S:
                    self._logged_s = now_s
                    log.exception("what arrived at %s could not be handled", packet.key)
