"""Protocols for the parts of rclpy in use, which has no stubs."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypedDict

NamesAndTypes = Sequence[tuple[str, Sequence[str]]]


class MessageInfo(TypedDict, total=False):
    """Metadata of a message in rclpy; before Iron, empty."""

    source_timestamp: int
    """Time of publication, ns since 1970 by the publisher's clock; 0 if unknown."""


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
    """A publisher or subscription in the graph; since Iron it has `topic_type_hash`, too."""

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
    """Sends a response to the request with this header; the executor calls it with a callback's result."""


class Reply(Protocol):
    """Future of a response."""

    def add_done_callback(self, callback: Callable[["Reply"], None]) -> None:
        """Have `callback` called on completion, on the executor's thread."""
        ...

    def result(self) -> object:
        """Return the response; raises the error of a failed request."""
        ...


class ServiceCaller(Protocol):
    """A client of a service."""

    def service_is_ready(self) -> bool:
        """Return True if there is a server."""
        ...

    def call_async(self, request: object) -> Reply:
        """Send a request."""
        ...

    def remove_pending_request(self, future: Reply) -> None:
        """Stop waiting for a response."""
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
        """Remove it from the graph."""
        ...

    def destroy_subscription(self, subscription: object) -> bool:
        """Remove it from the graph."""
        ...

    def destroy_service(self, service: ServiceServer) -> bool:
        """Remove it from the graph."""
        ...

    def destroy_client(self, client: ServiceCaller) -> bool:
        """Remove it from the graph."""
        ...

    def destroy_node(self) -> None:
        """Leave the graph."""
        ...

    def get_node_names_and_namespaces(self) -> Sequence[tuple[str, str]]:
        """Return the nodes that are present."""
        ...

    def get_topic_names_and_types(self) -> NamesAndTypes:
        """Return all topics."""
        ...

    def get_publisher_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return the topics a node publishes; raises if it has gone."""
        ...

    def get_subscriber_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return the topics a node subscribes to; raises if it has gone."""
        ...

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return the services a node serves; raises if it has gone."""
        ...

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """Return the services a node calls; raises if it has gone."""
        ...

    def get_publishers_info_by_topic(self, topic_name: str) -> Sequence[EndInfo]:
        """Return the publishers of a topic."""
        ...

    def get_subscriptions_info_by_topic(self, topic_name: str) -> Sequence[EndInfo]:
        """Return the subscriptions of a topic."""
        ...


class Executor(Protocol):
    """Calls the callbacks of nodes, on the thread that spins it."""

    def add_node(self, node: Node) -> bool:
        """Call the callbacks of `node`, too."""
        ...

    def spin(self) -> None:
        """Run callbacks until `shutdown`; raises the exceptions of callbacks and of reading requests."""
        ...

    def create_task(self, callback: Callable[[], None]) -> object:
        """Call `callback` on the executor's thread."""
        ...

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End `spin`."""
        ...


class RosContext(Protocol):
    """State that nodes belong to."""

    def init(self, args: list[str], *, initialize_logging: bool, domain_id: int) -> None:
        """Initialize it."""
        ...

    def ok(self) -> bool:
        """Return True until it is shut down."""
        ...

    def try_shutdown(self) -> None:
        """Shut it down."""
        ...
