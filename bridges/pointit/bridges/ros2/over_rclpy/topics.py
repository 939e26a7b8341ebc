"""Publishers and subscriptions of ROS topics through rclpy, as raw CDR."""

import collections
import logging
import threading
import time
from collections.abc import Callable

from pointit.bridges.ros2.graph.backend import Qos, check_cdr
from pointit.bridges.ros2.over_rclpy.dds_context import DdsContext
from pointit.bridges.ros2.over_rclpy.rclpy_types import MessageInfo
from pointit.runtime.errors import BusClosedError

log = logging.getLogger(__name__)

MIN_CAPACITY = 64
"""Minimum number of messages queued for the loop, even if a topic's QoS keeps fewer."""


class DdsWriter:
    """Publisher of one topic."""

    is_read = False
    """DDS shows every subscription in the graph."""

    def __init__(self, context: DdsContext, topic: str, message: type[object], qos: Qos) -> None:
        self._context = context
        self._topic = topic
        self._echoes = context.echoes[topic]
        self._publisher = context.node.create_publisher(message, topic, context.rclpy.profile(qos))
        self._closed = False
        context.ends.add(self)

    def put(self, cdr: bytes) -> None:
        """Send; returns at once, and never blocks on readers.

        Raises:
            ValueError: If `cdr` is not CDR.
            BusClosedError: If this writer or its backend is closed.
        """
        check_cdr(cdr)
        if self._closed or self._context.is_closed:
            raise BusClosedError("the writer was closed")
        # DDS stamps messages with the operating system's clock, not with the site's.
        sent = self._echoes.begin(cdr, time.time_ns())
        try:
            self._publisher.publish(cdr)
        except RuntimeError as error:  # an error of rcl; the next message may succeed
            why = str(error).partition("\n")[0][:200]
            self._context.warnings.show_briefly(
                f"sending {self._topic}", f"{self._topic} could not be sent to ROS: {why}"
            )
        finally:
            sent.ended_ns = time.time_ns()

    def close(self) -> None:
        """Stop publishing."""
        if not self._closed:
            self._closed = True
            if not self._context.is_closed:
                self._context.node.destroy_publisher(self._publisher)
            self._context.ends.discard(self)


class DdsReader:
    """Subscription of one topic, without own messages: a queue between the executor's thread and the loop."""

    def __init__(
        self,
        context: DdsContext,
        topic: str,
        message: type[object],
        qos: Qos,
        handler: Callable[[bytes], None],
    ) -> None:
        """Declare; `handler` gets the CDR of what comes, in the loop."""
        self._context = context
        self._topic = topic
        self._handler = handler
        self._echoes = context.echoes[topic]
        self._lock = threading.Lock()
        self._queue: collections.deque[bytes] = collections.deque(maxlen=max(qos.depth, MIN_CAPACITY))
        self._marked = False
        self._closed = False
        self._oversized = 0
        self._overrun = 0
        self._lost = 0
        """Number of dropped messages at the last warning."""
        take = self._take if context.rclpy.has_info else self._take_bare
        profile = context.rclpy.profile(qos)
        self._subscription = context.node.create_subscription(message, topic, take, profile, raw=True)
        context.ends.add(self)

    def close(self) -> None:
        """Stop receiving; no handler runs afterwards."""
        if not self._closed:
            self._closed = True
            if not self._context.is_closed:
                self._context.node.destroy_subscription(self._subscription)
            self._context.ends.discard(self)

    def _take_bare(self, cdr: bytes) -> None:  # on the executor's thread
        self._take(cdr, {})

    def _take(self, cdr: bytes, info: MessageInfo) -> None:  # on the executor's thread
        if self._closed or self._echoes.is_ours(cdr, info.get("source_timestamp", 0)):
            return
        with self._lock:
            if len(cdr) > self._context.max_bytes:
                self._oversized += 1
            else:
                self._overrun += len(self._queue) == self._queue.maxlen
                self._queue.append(cdr)
            if self._marked:
                return
            self._marked = True
        self._context.dispatcher.schedule(self)

    def drain(self) -> None:
        """Handle queued messages; in the loop."""
        with self._lock:
            waiting = tuple(self._queue)
            self._queue.clear()
            self._marked = False
            oversized, overrun = self._oversized, self._overrun
        if oversized + overrun != self._lost and not self._closed:
            self._lost = oversized + overrun
            self._context.warnings.show_losses(self._topic, oversized, overrun, self._context.max_bytes)
        for cdr in waiting:
            if self._closed or self._context.is_closed:
                return
            try:
                self._handler(cdr)
            except Exception:
                if self._context.dispatcher.should_log(self._topic, "error"):
                    log.exception("what arrived on %s could not be handled", self._topic)
