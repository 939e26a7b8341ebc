"""Publishers and subscriptions of ROS topics through rclpy, as raw CDR."""

import time
from collections.abc import Callable

from pointit.bridges.ros2.graph.backend import Qos, check_cdr
from pointit.bridges.ros2.graph.node_backend import MessageQueue, RosEndpoint
from pointit.bridges.ros2.over_rclpy.dds_context import DdsContext
from pointit.bridges.ros2.over_rclpy.rclpy_types import MessageInfo
from pointit.runtime.errors import BusClosedError


class DdsWriter(RosEndpoint[DdsContext]):
    """Publisher of one topic."""

    is_read = False
    """DDS shows every subscription in the graph."""

    def __init__(self, context: DdsContext, topic: str, message: type[object], qos: Qos) -> None:
        super().__init__(context, topic)
        self._echoes = context.echoes[topic]
        self._publisher = context.node.create_publisher(message, topic, context.rclpy.profile(qos))
        context.ends.add(self)

    def put(self, cdr: bytes) -> None:
        """Send; returns at once, and never blocks on readers.

        Raises:
            ValueError: If `cdr` is not CDR.
            BusClosedError: If this writer or its backend is closed.
        """
        check_cdr(cdr)
        if self.is_closed or self._context.is_closed:
            raise BusClosedError("the writer was closed")
        # DDS stamps messages with the operating system's clock, not with the site's.
        sent = self._echoes.begin(cdr, time.time_ns())
        try:
            self._publisher.publish(cdr)
        except RuntimeError as error:  # an error of rcl; the next message may succeed
            why = str(error).partition("\n")[0][:200]
            self._context.warnings.show_briefly(
                f"sending {self.name}", f"{self.name} could not be sent to ROS: {why}"
            )
        finally:
            sent.ended_ns = time.time_ns()

    def _undeclare(self) -> None:
        self._context.node.destroy_publisher(self._publisher)


class DdsReader(RosEndpoint[DdsContext]):
    """Subscription of one topic, without own messages."""

    def __init__(
        self,
        context: DdsContext,
        topic: str,
        message: type[object],
        qos: Qos,
        handler: Callable[[bytes], None],
    ) -> None:
        """Declare; `handler` gets the CDR of what comes, in the loop."""
        super().__init__(context, topic)
        self._echoes = context.echoes[topic]
        self._queue = MessageQueue(context, topic, handler, qos)
        take = self._take if context.rclpy.has_info else self._take_bare
        profile = context.rclpy.profile(qos)
        self._subscription = context.node.create_subscription(message, topic, take, profile, raw=True)
        context.ends.add(self)

    def _undeclare(self) -> None:
        self._queue.close()
        self._context.node.destroy_subscription(self._subscription)

    def _take_bare(self, cdr: bytes) -> None:  # on the executor's thread
        self._take(cdr, {})

    def _take(self, cdr: bytes, info: MessageInfo) -> None:  # on the executor's thread
        if not self._echoes.is_ours(cdr, info.get("source_timestamp", 0)):
            self._queue.put(cdr, is_oversized=len(cdr) > self._context.max_bytes)
