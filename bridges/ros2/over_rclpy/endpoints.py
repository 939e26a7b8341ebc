"""Endpoints over rclpy: the graph, their shared context, servers and clients of ROS services.

No core: it waits for a network.
"""

import asyncio
import collections
import contextlib
import functools
import logging
import math
import threading
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import Endpoint, EndpointKind, Graph, RosType, Server
from pointit.bridges.ros2.graph.node_backend import NodeContext, RosEndpoint, RosServiceServer
from pointit.bridges.ros2.over_rclpy.rclpy_library import (
    EndInfo,
    NamesAndTypes,
    Node,
    Rclpy,
    Reply,
    ServiceClass,
    class_of,
)
from pointit.bridges.ros2.types.definitions import INTERFACES
from pointit.runtime.bus.mailbox import Dispatcher
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.plugin_guard import WarningSink

log = logging.getLogger(__name__)

Traits = tuple[tuple[str, tuple[str, ...]], ...]

End = TypeVar("End")

MAX_NODES = 2000
"""Maximum number of nodes read."""
WHOLE_EVERY = 4
"""One of this many reads asks for everything, 0.3 ms a topic; the others ask only for lists of names."""
REMEMBERED = 256
"""Maximum number of remembered messages of a topic; they come back within milliseconds."""

MAX_PADDING = 3
"""Maximum number of bytes that middlewares append on delivery."""

COARSE_NS = 1000
"""Resolution of times, which a middleware may cut down to microseconds."""
MAX_OPEN = 64
"""Maximum number of open requests to one service; further ones get an empty response."""
LOOK_S = 0.05
"""Interval (s) of checking for a server, of which rclpy does not notify."""


class GraphReader:
    """Reads the graph and detects changes, of which rclpy does not notify."""

    def __init__(self, rclpy: Rclpy, node: Node, *, name: str, domain: int) -> None:
        """Create it without reading.

        Args:
            rclpy: the library.
            node: ours.
            name: our node's full name.
            domain: ROS_DOMAIN_ID; rclpy does not see others.
        """
        self._rclpy = rclpy
        self._node = node
        self._name = name
        self._domain = domain
        self._traits: object = None
        self._last_read: tuple[Graph, int] | None = None
        self._unread = 0
        """Reads since the last complete one."""
        self.namesakes = 0
        """Number of nodes with our name."""

    def read(self) -> Graph | None:
        """Return the graph, or None if it and `namesakes` are unchanged.

        An endpoint replaced by one of another quality of service is seen at most `WHOLE_EVERY` reads later.
        """
        # Lists of names, which are cheap, show most changes
        topics = _traits(self._node.get_topic_names_and_types())
        nodes = [tuple(node) for node in self._node.get_node_names_and_namespaces()[:MAX_NODES]]
        counts = collections.Counter(full_name(*node) for node in nodes)
        held: dict[str, tuple[Traits, ...]] = {}
        for node in dict.fromkeys(nodes):
            held[full_name(*node)] = self._held(*node)
        traits = (topics, sorted(counts.items()), sorted(held.items()))
        self._unread += 1
        if traits == self._traits and self._unread < WHOLE_EVERY:
            return None
        self._unread = 0
        self._traits = traits
        self.namesakes = max(counts[self._name] - 1, 0)

        # Endpoints of topics with their quality of service, which services do not show
        endpoints: set[Endpoint] = set()
        for topic, _ in topics:
            publishers = self._node.get_publishers_info_by_topic(topic)
            endpoints.update(self._ends("publisher", topic, publishers))
            subscribers = self._node.get_subscriptions_info_by_topic(topic)
            endpoints.update(self._ends("subscriber", topic, subscribers))
        for name, (_, _, services, clients) in held.items():
            endpoints.update(self._services("server", name, services))
            endpoints.update(self._services("client", name, clients))

        graph = Graph(nodes=frozenset(counts), endpoints=frozenset(endpoints))
        if self._last_read == (graph, self.namesakes):
            return None
        self._last_read = graph, self.namesakes
        return graph

    def forget(self) -> None:
        """Reset the cache, so that the next `read` queries the whole graph."""
        self._traits = None

    def _held(self, name: str, namespace: str) -> tuple[Traits, ...]:
        node = self._node
        try:
            publishers = _traits(node.get_publisher_names_and_types_by_node(name, namespace))
            subscribers = _traits(node.get_subscriber_names_and_types_by_node(name, namespace))
            services = _traits(node.get_service_names_and_types_by_node(name, namespace))
            clients = _traits(node.get_client_names_and_types_by_node(name, namespace))
        except RuntimeError:  # it has gone meanwhile; the next read does not see it
            return ((), (), (), ())
        return (publishers, subscribers, services, clients)

    def _ends(self, kind: EndpointKind, topic: str, infos: Sequence[EndInfo]) -> list[Endpoint]:
        endpoints: list[Endpoint] = []
        for info in infos:
            if info.topic_type.count("/") != 2:
                continue
            node = full_name(info.node_name, info.node_namespace)
            ros_type = RosType(name=info.topic_type, hash=hash_of(info))
            endpoints.append(self._endpoint(kind, node, topic, ros_type, info))
        return endpoints

    def _services(self, kind: EndpointKind, node: str, services: Traits) -> list[Endpoint]:
        endpoints: list[Endpoint] = []
        for service, type_names in services:
            for type_name in type_names:
                if type_name.count("/") == 2:
                    ros_type = RosType(name=type_name, hash="")
                    endpoints.append(self._endpoint(kind, node, service, ros_type))
        return endpoints

    def _endpoint(
        self, kind: EndpointKind, node: str, name: str, ros_type: RosType, info: EndInfo | None = None
    ) -> Endpoint:
        qos = None if info is None else self._rclpy.qos(info.qos_profile)
        return Endpoint(
            kind=kind,
            node=node,
            name=name,
            type=ros_type,
            qos=qos,
            domain=self._domain,
            is_ours=node == self._name,
        )


def full_name(name: str, namespace: str) -> str:
    """Return a node's full name."""
    return f"{namespace.rstrip('/')}/{name}"


def hash_of(info: EndInfo) -> str:
    """Return the hash of an endpoint's type as `RIHS01_…`, or `""` if unknown."""
    text = str(info.topic_type_hash)
    return text if text.startswith("RIHS01_") else ""


def _traits(names: NamesAndTypes) -> Traits:
    return tuple((name, tuple(types)) for name, types in names)


class DdsContext(NodeContext):
    """Our node, and the loop of its endpoints."""

    def __init__(self, rclpy: Rclpy, node: Node, config: BackendConfig, warnings: WarningSink) -> None:
        super().__init__(warnings, Dispatcher())
        self.rclpy = rclpy
        self.node = node
        self.echoes: dict[str, LoopbackFilter] = collections.defaultdict(LoopbackFilter)
        """By topic."""
        self._config = config

    def class_of(self, kind: RosType) -> Any:
        """Return the Python class of a type, or None, with a warning, if it is not built in this ROS."""
        try:
            return class_of(kind.name)
        except LookupError:
            package = kind.name.partition("/")[0]
            if (INTERFACES / package).is_dir():
                remedy = (
                    f"build them with `colcon build --base-paths {INTERFACES}`, source install/setup.bash"
                )
            else:
                debian_name = package.replace("_", "-")
                remedy = f"install ros-{self._config.distro}-{debian_name}"
            sentence = (
                f"this ROS has no types of {package}, whose topics and services are left out; {remedy} and "
                "start again"
            )
            self.warnings.show(f"package {package}", sentence)
            return None

    def declared(self, kind: RosType, name: str, declare: Callable[[], End]) -> End | None:
        """Return the endpoint made by `declare`, or None, with a warning, if rclpy rejects its type."""
        try:
            return declare()
        except Exception as error:  # noqa: BLE001 - rclpy raises what comes out of the type's libraries
            first_line = str(error).partition("\n")[0]
            reason = first_line[:200] or type(error).__name__
            remedy = "rebuild its package for this ROS"
            sentence = f"rclpy refuses {kind.name}, so {name} is left out: {reason}; {remedy}"
            self.warnings.show(f"refusal of {kind.name}", sentence)
            return None

    def is_other(self, kind: RosType, name: str, infos: Callable[[str], Sequence[EndInfo]]) -> bool:
        """Return True, with a warning, if this ROS has been built with another definition of `kind`.

        Nodes would misread our bytes and cannot reject them.

        Args:
            kind: ours.
            name: of a topic with an endpoint of ours.
            infos: returns the endpoints of that kind.
        """
        # The hash of our own endpoint in the graph: rclpy takes it from the installed definition
        installed: set[str] = set()
        for info in infos(name):
            node = full_name(info.node_name, info.node_namespace)
            if node == self._config.node and info.topic_type == kind.name:
                installed.add(hash_of(info))
        installed.discard("")
        if not installed or kind.hash in installed:
            return False
        if not kind.hash.startswith("RIHS01_"):
            return False

        other_hash = min(installed)
        sentence = (
            f"this ROS has another definition of {kind.name} than PointIt (hash {other_hash[:20]}, not "
            f"{kind.hash[:20]}), so {name} is left out; set distro to this ROS's, or rebuild the package "
            f"from {INTERFACES}"
        )
        self.warnings.show(f"definition of {kind.name}", sentence)
        return True


class NullEndpoint:
    """Stands for an endpoint that could not be declared; a warning names it."""

    is_read = False

    def put(self, cdr: bytes) -> None:
        """Send nothing."""

    def close(self) -> None:
        """Do nothing."""


class LoopbackFilter:
    """Messages recently sent to one topic: rclpy delivers our own like any other.

    Only rclpy from Kilted on names a message's publisher; every one gives the time of publication.
    It is taken inside `publish`, by the same clock as ours: a message with the bytes of one of ours,
    published while we published, is ours.
    """

    def __init__(self) -> None:
        self._sent: collections.deque[_Sent] = collections.deque(maxlen=REMEMBERED)

    def begin(self, cdr: bytes, now_ns: int) -> "_Sent":
        """Record a message before it is sent, at `now_ns` of the operating system's clock."""
        sent = _Sent(len(cdr), hash(cdr), now_ns)
        self._sent.append(sent)
        return sent

    def is_ours(self, cdr: bytes, source_ns: int) -> bool:
        """Return True if we published `cdr` at `source_ns`."""
        for sent in self._sent.copy():  # the loop appends meanwhile
            if sent.began_ns - COARSE_NS <= source_ns < sent.ended_ns and sent.is_in(cdr):
                return True
        return False


class _Sent:
    """One message of ours."""

    __slots__ = ("began_ns", "ended_ns", "length", "mark")

    def __init__(self, length: int, mark: int, began_ns: int) -> None:
        self.length = length
        self.mark = mark
        self.began_ns = began_ns
        self.ended_ns = math.inf
        """Infinite until it is known: the message may be back before `publish` returns."""

    def is_in(self, cdr: bytes) -> bool:
        """Return True if `cdr` is this message, with or without padding."""
        padding = len(cdr) - self.length
        return 0 <= padding <= MAX_PADDING and hash(cdr[: self.length]) == self.mark


class DdsServiceServer(RosServiceServer[DdsContext]):
    """Answers one service."""

    def __init__(self, context: DdsContext, service: str, types: ServiceClass, server: Server) -> None:
        """Declare.

        rclpy sends what a callback returns. A waiting callback would block all others, and a coroutine makes
        the executor repeat the request. So the callback returns the request, and `send_response`, which the
        executor calls with that and the header to answer to, hands both to the loop.
        """
        super().__init__(context, service, server)
        self._types = types
        self._is_made = threading.Event()
        self._service = context.node.create_service(types, service, self._on_request)
        self._send = self._service.send_response
        self._service.send_response = self._on_header
        self._is_made.set()
        context.ends.add(self)

    def _undeclare(self) -> None:
        self._context.node.destroy_service(self._service)

    def _on_request(self, request: object, _response: object) -> bytes:  # on the executor's thread
        self._is_made.wait()
        return self._context.rclpy.serialize(request)

    def _on_header(self, request: bytes, header: object) -> None:  # on the executor's thread
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._context.loop.call_soon_threadsafe(self._begin, request, header)

    def _begin(self, request: bytes, header: object) -> None:
        if self.is_closed or self._context.is_closed:
            return
        reason = ""
        if len(self._tasks) >= MAX_OPEN:
            reason = "too many requests are open"
        elif len(request) > self._context.max_bytes:
            reason = "it was too long"
        if reason:
            sentence = f"a request to {self.name} was refused: {reason}"
            self._context.warnings.show_briefly(f"requests to {self.name}", sentence)
            self._answer(self._types.Response(), header)
            return
        self._start(id(header), self._work(request, header))

    async def _work(self, request: bytes, header: object) -> None:
        types = self._types

        def decode(cdr: bytes) -> object:
            return self._context.rclpy.deserialize(cdr, types.Response)

        try:
            response = await self._response(request, decode)
        except RefusedError:  # DDS has no place for the reason, which the bridge's warnings have
            response = types.Response()
        self._answer(response, header)

    def _answer(self, response: object, header: object) -> None:
        if self.is_closed or self._context.is_closed:
            return
        try:
            self._send(response, header)
        except RuntimeError as error:  # an error of rcl: the client may be gone
            log.warning("an answer of %s could not be sent: %s", self.name, error)


class DdsClient(RosEndpoint[DdsContext]):
    """Client of one service."""

    def __init__(self, context: DdsContext, service: str, types: ServiceClass) -> None:
        super().__init__(context, service)
        self._types = types
        self._client = context.node.create_client(types, service)
        context.ends.add(self)

    async def call(self, request: bytes, *, timeout_s: float) -> bytes:
        """Return the response's CDR.

        Raises:
            TimeoutError: If there is no server, or no answer of it in time.
        """
        value = self._context.rclpy.deserialize(request, self._types.Request)
        problem = "no node serves it"
        reply: Reply | None = None
        try:
            async with asyncio.timeout(timeout_s):
                while not self._client.service_is_ready():  # noqa: ASYNC110 - rclpy has no event for it
                    await asyncio.sleep(LOOK_S)
                problem = "its server did not answer"
                outcome: asyncio.Future[object] = self._context.loop.create_future()
                reply = self._client.call_async(value)
                reply.add_done_callback(functools.partial(self._on_reply, outcome))
                return self._context.rclpy.serialize(await outcome)
        except TimeoutError as error:
            sentence = f"ROS service {self.name}: {problem} within {timeout_s:g} s"
            raise TimeoutError(sentence) from error
        finally:
            # rclpy keeps a request for ever that gets no answer; a destroyed client has none
            is_open = not self.is_closed and not self._context.is_closed
            if reply is not None and is_open:
                self._client.remove_pending_request(reply)

    def _undeclare(self) -> None:
        self._context.node.destroy_client(self._client)

    def _on_reply(self, outcome: "asyncio.Future[object]", reply: Reply) -> None:  # on the executor's thread
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._context.loop.call_soon_threadsafe(_settle, reply, outcome)


def _settle(reply: Reply, outcome: "asyncio.Future[Any]") -> None:
    if outcome.done():
        return
    try:
        outcome.set_result(reply.result())
    except Exception as error:  # noqa: BLE001 - handed to the caller
        outcome.set_exception(error)
