"""Interface of a backend that joins a ROS 2 graph by any middleware.

All handlers run in the event loop that opened the backend, one at a time.
"""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Literal, Protocol

Server = Callable[[bytes], Awaitable[bytes]]
"""Takes a request's CDR, returns the response's. The text of a `RefusedError` goes to the caller where the
middleware has a place for it (DDS has none: the response is empty); it raises nothing else."""


Distro = Literal["humble", "jazzy", "kilted", "lyrical", "rolling"]
"""A distribution of ROS 2."""

EndpointKind = Literal["publisher", "subscriber", "server", "client"]


@dataclass(frozen=True, kw_only=True)
class Qos:
    """Quality of service of an endpoint, as far as the bridge needs it."""

    depth: int = 10
    reliable: bool = True
    latched: bool = False
    """Late joiners get the last `depth` messages (ROS: transient local)."""
    lifespan_ns: int | None = None
    """Maximum age of messages for late joiners, or None if unlimited."""

    @property
    def lasts(self) -> bool:
        """Return True if late joiners get old messages whatever their age."""
        return self.latched and self.lifespan_ns is None


SENSOR = Qos(depth=5, reliable=False)
LATCHED = Qos(depth=1, latched=True)
SERVICE = Qos(depth=10)
ROSOUT = Qos(depth=1000, latched=True, lifespan_ns=10_000_000_000)
"""QoS of every genuine node's log."""


@dataclass(frozen=True, kw_only=True)
class RosType:
    """A message or service type as the graph names it."""

    name: str
    """`geometry_msgs/msg/PoseStamped`, `std_srvs/srv/Empty`."""
    hash: str
    """`RIHS01_` and 64 hexadecimal digits."""

    @property
    def dds_name(self) -> str:
        """Return the name as middlewares write it: `geometry_msgs::msg::dds_::PoseStamped_`."""
        package, kind, name = self.name.split("/")
        return f"{package}::{kind}::dds_::{name}_"


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """An endpoint of a topic or service in the graph."""

    kind: EndpointKind
    node: str
    """Its full name: `/user1/belt`."""
    name: str
    """Resolved name of the topic or service: `/user1/pointing_ray`."""
    type: RosType
    qos: Qos | None
    """None where it could not be read."""
    domain: int
    is_ours: bool = False
    is_bridge: bool = False
    """True if it belongs to another PointIt. Messages about its users are then ignored."""


@dataclass(frozen=True, kw_only=True)
class Graph:
    """All nodes and endpoints that are present."""

    nodes: frozenset[str]
    endpoints: frozenset[Endpoint]

    def within(self, domain: int) -> "Graph":
        """Return it without the endpoints of other domains, which ours never meet."""
        endpoints = frozenset(endpoint for endpoint in self.endpoints if endpoint.domain == domain)
        return replace(self, endpoints=endpoints)


class BackendHandle(Protocol):
    """Anything that a backend hands out. Closing twice is allowed, and closing the backend closes it."""

    def close(self) -> None:
        """Undeclare; no handler runs afterwards."""


class Writer(BackendHandle, Protocol):
    """Publisher of one topic."""

    @property
    def is_read(self) -> bool:
        """Return True if the middleware knows a reader, in the graph or not; False if it cannot tell."""
        ...

    def put(self, cdr: bytes) -> None:
        """Send; returns at once, and never blocks on readers."""


class Backend(Protocol):
    """A node in a ROS 2 graph."""

    @property
    def node(self) -> str:
        """Return our node's full name."""
        ...

    def advertise(self, topic: str, kind: RosType, qos: Qos) -> Writer:
        """Declare a publisher of the resolved name `topic` (`/user1/pointing_ray`)."""
        ...

    def subscribe(
        self, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]
    ) -> BackendHandle:
        """Call `handler(cdr)` for messages of other nodes. Our own messages are not returned."""
        ...

    def serve(self, service: str, kind: RosType, server: Server) -> BackendHandle:
        """Answer requests to `service`."""
        ...

    async def call(self, service: str, kind: RosType, request: bytes, *, timeout_s: float) -> bytes:
        """Return the CDR of a server's response.

        Raises:
            TimeoutError: If no node serves it, or not within `timeout_s`.
        """
        ...

    def watch(self, handler: Callable[[Graph], None]) -> BackendHandle:
        """Call `handler` with the graph now, and whenever it has changed."""
        ...

    @property
    def problem(self) -> str:
        """Return an error message if the connection itself fails, else `""`."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Return explanations why nothing happens where nothing is wrong: no nodes, no subscribers."""
        ...

    async def close(self) -> None:
        """Leave the graph; no handler runs afterwards."""
