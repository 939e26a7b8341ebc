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
        callback: Callable[[bytes, MessageInfo], None] | Callable[[bytes], None],
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
