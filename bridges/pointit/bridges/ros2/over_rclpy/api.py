"""What the bridge uses of rclpy, which has no stubs."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypedDict

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
        """Return True if somebody serves it."""
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
        """Return True if it has not ended."""
        ...

    def try_shutdown(self) -> None:
        """End."""
        ...
