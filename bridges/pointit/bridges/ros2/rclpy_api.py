"""What the bridge uses of rclpy, which has no stubs; it is imported when it is asked for, and not before."""

import importlib
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypedDict

from pointit.bridges.ros2.backend import Qos
from pointit.runtime.errors import ConfigError

NamesAndTypes = Sequence[tuple[str, Sequence[str]]]


class MessageInfo(TypedDict, total=False):
    """What rclpy tells of a message besides its bytes; before Iron, nothing."""

    source_timestamp: int
    """When it was published, ns since 1970 by the publisher's clock; 0: not known."""


class ServiceClass(Protocol):
    """Python class of a service type, `std_srvs.srv.Empty`."""

    Request: type[object]
    Response: type[object]


class Profile(Protocol):
    """Quality of service of one end."""

    depth: int
    reliability: object
    durability: object


class EndInfo(Protocol):
    """One publisher or subscription of somebody; since Iron it has `topic_type_hash`, too."""

    node_name: str
    node_namespace: str
    topic_type: str
    qos_profile: Profile


class Sender(Protocol):
    """A publisher."""

    def publish(self, msg: bytes) -> None:
        """Send CDR as it is."""
        ...


class ServiceServer(Protocol):
    """A server of a service."""

    send_response: Callable[[Any, object], None]
    """Takes a response and the request's header; the executor calls it with what a callback returns."""


class Reply(Protocol):
    """Future of a response."""

    def add_done_callback(self, callback: Callable[["Reply"], None]) -> None:
        """Have `callback` called when it is there, on the executor's thread."""
        ...

    def result(self) -> object:
        """Return the response; raises what went wrong."""
        ...


class ServiceCaller(Protocol):
    """A client of a service."""

    def service_is_ready(self) -> bool:
        """Return whether somebody serves it."""
        ...

    def call_async(self, request: object) -> Reply:
        """Send a request."""
        ...

    def remove_pending_request(self, future: Reply) -> None:
        """Wait for no response any more."""
        ...


class Node(Protocol):
    """A node; may be used on any thread."""

    def create_publisher(self, msg_type: type[object], topic: str, qos_profile: Profile) -> Sender:
        """Declare a publisher."""
        ...

    def create_subscription(
        self,
        msg_type: type[object],
        topic: str,
        callback: Callable[[bytes, MessageInfo], None] | Callable[[bytes], None],
        qos_profile: Profile,
        *,
        raw: bool,
    ) -> object:
        """Declare a subscription; raw: the callback gets CDR."""
        ...

    def create_service(
        self, srv_type: ServiceClass, srv_name: str, callback: Callable[[Any, Any], object]
    ) -> ServiceServer:
        """Declare a server."""
        ...

    def create_client(self, srv_type: ServiceClass, srv_name: str) -> ServiceCaller:
        """Declare a client."""
        ...

    def destroy_publisher(self, publisher: Sender) -> bool:
        """Take it back."""
        ...

    def destroy_subscription(self, subscription: object) -> bool:
        """Take it back."""
        ...

    def destroy_service(self, service: ServiceServer) -> bool:
        """Take it back."""
        ...

    def destroy_client(self, client: ServiceCaller) -> bool:
        """Take it back."""
        ...

    def destroy_node(self) -> None:
        """Leave the graph."""
        ...

    def get_node_names_and_namespaces(self) -> Sequence[tuple[str, str]]:
        """Return who is there."""
        ...

    def get_topic_names_and_types(self) -> NamesAndTypes:
        """Return all topics."""
        ...

    def get_publisher_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return what a node publishes; raises when it has gone."""
        ...

    def get_subscriber_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return what a node subscribes to; raises when it has gone."""
        ...

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return what a node serves; raises when it has gone."""
        ...

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return what services a node calls; raises when it has gone."""
        ...

    def get_publishers_info_by_topic(self, topic_name: str) -> Sequence[EndInfo]:
        """Return who publishes a topic."""
        ...

    def get_subscriptions_info_by_topic(self, topic_name: str) -> Sequence[EndInfo]:
        """Return who subscribes to a topic."""
        ...


class Executor(Protocol):
    """Calls the callbacks of nodes, on the thread that spins it."""

    def add_node(self, node: Node) -> bool:
        """Call the callbacks of `node`, too."""
        ...

    def spin(self) -> None:
        """Do so until `shutdown`; raises what a callback or the reading of a request raises."""
        ...

    def create_task(self, callback: Callable[[], None]) -> object:
        """Call `callback` on its thread."""
        ...

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End `spin`."""
        ...


class RosContext(Protocol):
    """What nodes live in."""

    def init(self, args: list[str], *, initialize_logging: bool, domain_id: int) -> None:
        """Begin."""
        ...

    def ok(self) -> bool:
        """Return whether it has not ended."""
        ...

    def try_shutdown(self) -> None:
        """End."""
        ...


@dataclass(frozen=True, kw_only=True)
class Rclpy:
    """The library, loaded."""

    new_context: Callable[[], RosContext]
    new_node: Callable[..., Node]
    new_executor: Callable[..., Executor]
    new_profile: Callable[..., Profile]
    reliability: Any
    """Enumeration of policies."""
    durability: Any
    serialize: Callable[[object], bytes]
    deserialize: Callable[[bytes, type[object]], object]
    has_info: bool
    """Whether callbacks are told a `MessageInfo`: from Iron on."""

    def profile(self, qos: Qos) -> Profile:
        """Return `qos` as rclpy takes it."""
        return self.new_profile(
            depth=qos.depth,
            reliability=self.reliability.RELIABLE if qos.reliable else self.reliability.BEST_EFFORT,
            durability=self.durability.TRANSIENT_LOCAL if qos.latched else self.durability.VOLATILE,
        )

    def qos(self, profile: Profile) -> Qos:
        """Return what `profile` says; DDS does not tell the depth of others."""
        return Qos(
            depth=profile.depth,
            reliable=profile.reliability == self.reliability.RELIABLE,
            latched=profile.durability == self.durability.TRANSIENT_LOCAL,
        )


def loaded() -> Rclpy:
    """Return rclpy.

    Raises:
        ConfigError: it is not there, or not for this Python.
    """
    try:
        qos = importlib.import_module("rclpy.qos")
        serialization = importlib.import_module("rclpy.serialization")
        return Rclpy(
            new_context=importlib.import_module("rclpy.context").Context,
            new_node=importlib.import_module("rclpy.node").Node,
            new_executor=importlib.import_module("rclpy.executors").SingleThreadedExecutor,
            new_profile=qos.QoSProfile,
            reliability=qos.ReliabilityPolicy,
            durability=qos.DurabilityPolicy,
            serialize=serialization.serialize_message,
            deserialize=serialization.deserialize_message,
            has_info=hasattr(importlib.import_module("rclpy.subscription").Subscription, "CallbackType"),
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
    """Return the installed Python class of `std_msgs/msg/Bool` or `std_srvs/srv/Empty`.

    Raises:
        LookupError: it is not built here.
    """
    package, kind, short = name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), short)
    except (ImportError, AttributeError) as error:
        raise LookupError(name) from error
