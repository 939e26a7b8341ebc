"""A node in a ROS 2 graph through an installed ROS, by any of its middlewares, DDS above all.

One thread spins rclpy's executor; its events reach the loop through bounded queues. rclpy does not notify of
changes in the graph (ros2/rclpy#929), so it is read once a second, and after every declaration of ours.

No core: it waits for a network in a thread.
"""

import functools
import logging
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import BackendHandle, Graph, Qos, RosType, Server, Writer
from pointit.bridges.ros2.graph.node_backend import MessageQueue, NodeBackend, RosEndpoint
from pointit.bridges.ros2.over_rclpy.endpoints import (
    DdsClient,
    DdsContext,
    DdsServiceServer,
    GraphReader,
    NullEndpoint,
)
from pointit.bridges.ros2.over_rclpy.rclpy_library import (
    EndInfo,
    Executor,
    MessageInfo,
    Node,
    Rclpy,
    RosContext,
    loaded,
)
from pointit.runtime.clock import Timer
from pointit.runtime.errors import BusClosedError, ConfigError
from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.machine import this_machine
from pointit.runtime.service.plugin_guard import WarningSink

log = logging.getLogger(__name__)

End = TypeVar("End", bound=BackendHandle)

LOOK_S = 1.0
"""Interval of reading the graph, s."""

SETTLE_S = 0.05
"""Time (s) to gather declarations of ours before the graph is read because of them."""

PAUSE_S = 0.05
"""Pause (s) after an error that stopped the executor, such as an unreadable request."""

NEEDS = (
    "they need the same ROS_DOMAIN_ID, on other machines a network that lets DDS discovery through, and "
    "neither ROS_LOCALHOST_ONLY=1 nor ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST here or there"
)
"""Conditions for other nodes to be seen."""


class DdsWriter(RosEndpoint[DdsContext]):
    """Publisher of one topic."""

    is_read = False
    """DDS shows every subscription in the graph."""

    def __init__(self, context: DdsContext, topic: str, message: type[object], qos: Qos) -> None:
        super().__init__(context, topic)
        self._echoes = context.echoes[topic]
        profile = context.rclpy.profile(qos)
        self._publisher = context.node.create_publisher(message, topic, profile)
        context.ends.add(self)

    def put(self, cdr: bytes) -> None:
        """Send; returns at once, and never blocks on readers.

        Raises:
            BusClosedError: If this writer or its backend is closed.
        """
        if self.is_closed or self._context.is_closed:
            raise BusClosedError("the writer was closed")
        # DDS stamps messages with the operating system's clock, not with the site's.
        sent = self._echoes.begin(cdr, this_machine().now_ns())
        try:
            self._publisher.publish(cdr)
        except RuntimeError as error:  # an error of rcl; the next message may succeed
            reason = str(error).partition("\n")[0][:200]
            sentence = f"{self.name} could not be sent to ROS: {reason}"
            self._context.warnings.show_briefly(f"sending {self.name}", sentence)
        finally:
            sent.ended_ns = this_machine().now_ns()

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
        """Declare the subscription. `handler` gets the CDR of each message in the loop."""
        super().__init__(context, topic)
        self._echoes = context.echoes[topic]
        self._queue = MessageQueue(context, topic, handler, qos)
        profile = context.rclpy.profile(qos)
        self._subscription = context.node.create_subscription(
            message, topic, self._on_message, profile, raw=True
        )
        context.ends.add(self)

    def _undeclare(self) -> None:
        self._queue.close()
        self._context.node.destroy_subscription(self._subscription)

    def _on_message(self, cdr: bytes, info: MessageInfo) -> None:  # on the executor's thread
        if not self._echoes.is_ours(cdr, info["source_timestamp"]):
            self._queue.put(cdr, is_oversized=len(cdr) > self._context.max_bytes)


@dataclass(frozen=True)
class RclpyNode:
    """rclpy's objects of one node."""

    rclpy: Rclpy
    context: RosContext
    node: Node
    executor: Executor

    def leave(self) -> None:
        """Leave the graph; the node must not be spinning any more."""
        self.node.destroy_node()
        self.context.try_shutdown()


def join(config: BackendConfig) -> RclpyNode:
    """Return our node; blocks for a moment.

    Raises:
        ConfigError: If rclpy is not there, or cannot join.
    """
    rclpy = loaded()
    namespace, _, name = config.node.rpartition("/")
    try:
        context = rclpy.new_context()
        # no arguments: the command line is not ROS's; no log files beside those of PointIt
        context.init([], initialize_logging=False, domain_id=config.domain_id)
        node = rclpy.new_node(
            name,
            namespace=namespace or "/",
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        executor = rclpy.new_executor(context=context)
        executor.add_node(node)
    except Exception as error:  # any error of rcl, of a middleware or of their shared libraries
        first_line = str(error).partition("\n")[0]
        reason = first_line[:300] or type(error).__name__
        middleware = os.environ.get("RMW_IMPLEMENTATION", "")
        raise ConfigError(
            f"backend.kind dds: rclpy cannot join the ROS graph as {config.node}, domain {config.domain_id} "
            f"({reason}); check that RMW_IMPLEMENTATION={middleware} names an "
            "installed middleware and that `ros2 node list` works in this terminal"
        ) from error
    return RclpyNode(rclpy, context, node, executor)


async def opened_rclpy(config: BackendConfig, warnings: WarningSink) -> "RclpyBackend":
    """Return our node in the ROS graph; may be cancelled at any time.

    Raises:
        ConfigError: If rclpy is not there, or cannot join.
    """
    joined = await in_daemon_thread(lambda: join(config), "rclpy-open", discard=RclpyNode.leave)
    return RclpyBackend(joined, config, warnings)


class RclpyBackend(NodeBackend[DdsContext]):
    """Our node; see `pointit.bridges.ros2.graph.backend.Backend` for the contract.

    It owns `joined`, which it begins to spin; is to be made in the loop.
    """

    def __init__(self, joined: RclpyNode, config: BackendConfig, warnings: WarningSink) -> None:
        context = DdsContext(joined.rclpy, joined.node, config, warnings)
        # The distribution does not matter here: DDS distinguishes types by their names.
        super().__init__(context, config, distro="", needs=NEEDS, matching="type")
        self._joined = joined
        self._config = config
        self._warnings = context.warnings
        self._reader = GraphReader(joined.rclpy, joined.node, name=config.node, domain=config.domain_id)
        self._is_left = threading.Event()
        self._spinning = threading.Thread(target=self._spin, name="rclpy-spin", daemon=True)
        self._spinning.start()
        self._look_timer = Timer(context.loop.call_later, self._read_soon)
        self._warn_of_environment()
        self._look_timer.start(0.0)

    @property
    def problem(self) -> str:
        """Return `""`: there is no connection that fails, all nodes are peers."""
        return ""

    def advertise(self, topic: str, kind: RosType, qos: Qos) -> Writer:
        """Declare a publisher of the resolved name `topic`; it is silent where this ROS lacks the type."""

        def declare(message: Any) -> DdsWriter:
            return DdsWriter(self._context, topic, message, qos)

        return self._declared(kind, topic, declare, self._joined.node.get_publishers_info_by_topic)

    def subscribe(
        self, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]
    ) -> BackendHandle:
        """Call `handler(cdr)` for messages of other nodes. Our own messages are not returned."""

        def declare(message: Any) -> DdsReader:
            return DdsReader(self._context, topic, message, qos, handler)

        return self._declared(kind, topic, declare, self._joined.node.get_subscriptions_info_by_topic)

    def serve(self, service: str, kind: RosType, server: Server) -> BackendHandle:
        """Answer requests to `service`, unless this ROS lacks its type."""

        def declare(types: Any) -> DdsServiceServer:
            return DdsServiceServer(self._context, service, types, server)

        return self._declared(kind, service, declare)

    def _declared(
        self,
        kind: RosType,
        name: str,
        declare: Callable[[Any], End],
        infos: Callable[[str], Sequence[EndInfo]] | None = None,
    ) -> End | NullEndpoint:
        """Return the endpoint that `declare` makes of the built type; `infos` returns those of its kind."""
        self._context.check_open()
        built = self._context.class_of(kind)
        if built is None:
            return NullEndpoint()
        end = self._context.declared(kind, name, lambda: declare(built))
        if end is None:
            return NullEndpoint()

        # Only a declared endpoint shows the hash of the installed definition
        if infos is not None and self._context.is_other(kind, name, infos):
            end.close()
            return NullEndpoint()
        self._look_timer.start(SETTLE_S)
        return end

    def _client(self, service: str, kind: RosType) -> DdsClient:
        types = self._context.class_of(kind)
        if types is None:
            raise TimeoutError(f"ROS service {service}: this ROS lacks {kind.name}")
        return DdsClient(self._context, service, types)

    async def close(self) -> None:
        """Leave the graph; no handler runs afterwards."""
        if self._context.is_closed:
            return
        self._context.dispatcher.close()
        self._look_timer.cancel()
        self._close_endpoints()
        await in_daemon_thread(self._leave, "rclpy-close")

    def _leave(self) -> None:
        self._is_left.set()
        self._joined.executor.shutdown(timeout_sec=0.0)
        self._spinning.join()
        self._joined.leave()

    def _spin(self) -> None:
        while not self._is_left.is_set():
            try:
                self._joined.executor.spin()
            except Exception as error:  # noqa: BLE001 - a request that cannot be read must not end all else
                if not self._is_left.is_set():
                    reason = str(error).partition("\n")[0][:200]
                    sentence = f"something from ROS was dropped by rclpy: {reason}"
                    self._in_loop(functools.partial(self._warnings.show_briefly, "rclpy", sentence))
            self._is_left.wait(PAUSE_S)

    def _in_loop(self, work: Callable[[], None]) -> None:
        """Do `work` in the loop, unless the backend is closed by then."""

        def run() -> None:
            if not self._context.is_closed:
                work()

        try:
            self._context.loop.call_soon_threadsafe(run)
        except RuntimeError:  # the loop is closed
            self._is_left.set()

    def _read_soon(self) -> None:
        self._joined.executor.create_task(self._read)

    def _read(self) -> None:  # on the executor's thread
        graph: Graph | None = None
        try:
            graph = self._reader.read()
        except Exception:  # a node left during the reading; the next one succeeds
            self._reader.forget()
            log.debug("the ROS graph could not be read", exc_info=True)
        self._in_loop(functools.partial(self._show, graph))

    def _show(self, graph: Graph | None) -> None:
        self._look_timer.start(LOOK_S)
        if graph is None:
            return
        problems: dict[str, str] = {}
        if self._reader.namesakes:
            problems["node"] = (
                f"another ROS node is called {self.node}: neither sees what the other has; "
                "set node to another name in one of them, and if it is another PointIt bridge domain_id, too"
            )
        self._graph_monitor.show(graph, problems)

    def _warn_of_environment(self) -> None:
        """Warn if environment variables of ROS differ from the configuration."""
        domain_id = f"{self._config.domain_id}"
        for variable, setting, field in (
            ("ROS_DOMAIN_ID", domain_id, "domain_id"),
            ("ROS_DISTRO", self._config.distro, "distro"),
        ):
            value = os.environ.get(variable, setting)
            if value in ("", setting):
                continue
            shown = value[:20]
            sentence = (
                f"{variable} is {shown} in this terminal, but backend.{field} is {setting}: set "
                f"backend.{field} to {shown} to meet the nodes that are started there"
            )
            self._warnings.show(variable, sentence)
