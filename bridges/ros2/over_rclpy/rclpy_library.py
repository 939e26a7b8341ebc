"""rclpy and the types built with it, imported on demand, with protocols in place of stubs."""

import importlib
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypedDict

from pointit.bridges.ros2.graph.backend import Qos
from pointit.runtime.errors import ConfigError

NamesAndTypes = Sequence[tuple[str, Sequence[str]]]


class MessageInfo(TypedDict):
    """Metadata of a message in rclpy."""

    source_timestamp: int
    """Time of publication, ns since 1970 by the publisher's clock."""


class ServiceClass(Protocol):
    """Python class of a service type, `std_srvs.srv.Empty`."""

    Request: type[object]
    Response: type[object]


class Profile(Protocol):
    """Quality of service of an endpoint."""

    depth: int
    reliability: object
    durability: object


class EndInfo(Protocol):
    """A publisher or subscription in the graph."""

    node_name: str
    node_namespace: str
    topic_type: str
    topic_type_hash: object
    qos_profile: Profile


class Sender(Protocol):
    """A publisher."""

    publish: Callable[[bytes], None]
    """Sends CDR as it is."""


class ServiceServer(Protocol):
    """A server of a service."""

    send_response: Callable[[Any, object], None]
    """Sends a response to the request with this header; the executor calls it with a callback's result."""


class Reply(Protocol):
    """Future of a response."""

    add_done_callback: Callable[[Callable[["Reply"], None]], None]
    """Has the callback called on completion, on the executor's thread."""
    result: Callable[[], object]
    """Returns the response; raises the error of a failed request."""


class ServiceCaller(Protocol):
    """A client of a service."""

    service_is_ready: Callable[[], bool]
    call_async: Callable[[object], Reply]
    remove_pending_request: Callable[[Reply], None]
    """Stops waiting for a response."""


class Node(Protocol):
    """A node; may be used on any thread."""

    create_publisher: Callable[[type[object], str, Profile], Sender]
    create_service: Callable[[ServiceClass, str, Callable[[Any, Any], object]], ServiceServer]
    create_client: Callable[[ServiceClass, str], ServiceCaller]
    destroy_publisher: Callable[[Sender], bool]
    destroy_subscription: Callable[[object], bool]
    destroy_service: Callable[[ServiceServer], bool]
    destroy_client: Callable[[ServiceCaller], bool]
    destroy_node: Callable[[], None]
    get_node_names_and_namespaces: Callable[[], Sequence[tuple[str, str]]]
    get_topic_names_and_types: Callable[[], NamesAndTypes]
    get_publisher_names_and_types_by_node: Callable[[str, str], NamesAndTypes]
    """Returns the topics that the node of a name and namespace publishes; raises if it has gone."""
    get_subscriber_names_and_types_by_node: Callable[[str, str], NamesAndTypes]
    get_service_names_and_types_by_node: Callable[[str, str], NamesAndTypes]
    get_client_names_and_types_by_node: Callable[[str, str], NamesAndTypes]
    get_publishers_info_by_topic: Callable[[str], Sequence[EndInfo]]
    get_subscriptions_info_by_topic: Callable[[str], Sequence[EndInfo]]

    def create_subscription(
        self,
        msg_type: type[object],
        topic: str,
        callback: Callable[[bytes, MessageInfo], None],
        qos_profile: Profile,
        *,
        raw: bool,
    ) -> object:
        """Declare a subscription; raw: the callback gets CDR."""


class Executor(Protocol):
    """Calls the callbacks of nodes, on the thread that spins it."""

    add_node: Callable[[Node], bool]
    spin: Callable[[], None]
    """Runs callbacks until `shutdown`; raises the exceptions of callbacks and of reading requests."""
    create_task: Callable[[Callable[[], None]], object]
    """Calls a function on the executor's thread."""

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End `spin`."""
        ...


class RosContext(Protocol):
    """State that nodes belong to."""

    ok: Callable[[], bool]
    """Returns True until it is shut down."""
    try_shutdown: Callable[[], None]

    def init(self, args: list[str], *, initialize_logging: bool, domain_id: int) -> None:
        """Initialize it."""


@dataclass(frozen=True, kw_only=True)
class Rclpy:
    """The library, loaded."""

    new_context: Callable[[], RosContext]
    new_node: Callable[..., Node]
    new_executor: Callable[..., Executor]
    new_profile: Callable[..., Profile]
    new_duration: Callable[..., object]
    reliability: Any
    """Enumeration of policies."""
    durability: Any
    serialize: Callable[[object], bytes]
    deserialize: Callable[[bytes, type[object]], object]

    def profile(self, qos: Qos) -> Profile:
        """Return `qos` as an rclpy profile."""
        ends = {} if qos.lifespan_ns is None else {"lifespan": self.new_duration(nanoseconds=qos.lifespan_ns)}
        return self.new_profile(
            **ends,
            depth=qos.depth,
            reliability=self.reliability.RELIABLE if qos.reliable else self.reliability.BEST_EFFORT,
            durability=self.durability.TRANSIENT_LOCAL if qos.latched else self.durability.VOLATILE,
        )

    def qos(self, profile: Profile) -> Qos:
        """Return the `Qos` of `profile`. DDS does not show the depth of others, and lifespan is not used."""
        return Qos(
            depth=profile.depth,
            reliable=profile.reliability == self.reliability.RELIABLE,
            latched=profile.durability == self.durability.TRANSIENT_LOCAL,
        )


ACTION_PARTS = {
    "SendGoal": "SendGoalService",
    "GetResult": "GetResultService",
    "FeedbackMessage": "FeedbackMessage",
}
"""Attributes of an action's class that are its services and topic."""


def loaded() -> Rclpy:
    """Return rclpy.

    Raises:
        ConfigError: If it is not there, or not for this Python.
    """
    try:
        qos = importlib.import_module("rclpy.qos")
        serialization = importlib.import_module("rclpy.serialization")
        return Rclpy(
            new_context=importlib.import_module("rclpy.context").Context,
            new_node=importlib.import_module("rclpy.node").Node,
            new_executor=importlib.import_module("rclpy.executors").SingleThreadedExecutor,
            new_profile=qos.QoSProfile,
            new_duration=importlib.import_module("rclpy.duration").Duration,
            reliability=qos.ReliabilityPolicy,
            durability=qos.DurabilityPolicy,
            serialize=serialization.serialize_message,
            deserialize=serialization.deserialize_message,
        )
    except (ImportError, AttributeError, OSError) as error:
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        if isinstance(error, ModuleNotFoundError) and error.name == "rclpy":
            what = f"there is no rclpy for this Python {python}"
        else:
            what = f"rclpy does not load in this Python {python} ({str(error).partition(chr(10))[0][:200]})"
        distro = os.environ.get("ROS_DISTRO") or "jazzy"
        raise ConfigError(
            f"backend.kind dds: {what}; run `source /opt/ros/{distro}/setup.bash` and start PointIt with the "
            "Python that this ROS is built for; or use kind rmw_zenoh"
        ) from error


def class_of(name: str) -> Any:
    """Return the installed Python class of `std_msgs/msg/Bool`, `std_srvs/srv/Empty`, or a part of an action.

    Raises:
        LookupError: If it is not built here.
    """
    package, kind, short = name.split("/")
    try:
        module = importlib.import_module(f"{package}.{kind}")
        action, _, part = short.rpartition("_")
        if kind == "action" and part in ACTION_PARTS:
            return getattr(getattr(module, action).Impl, ACTION_PARTS[part])
        return getattr(module, short)
    except (ImportError, AttributeError) as error:
        raise LookupError(name) from error
