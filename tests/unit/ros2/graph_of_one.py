"""A ROS graph for tests, whose only other node is the test."""

import contextlib
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass, field
from typing import Any

from pointit.bridges.ros2.graph.backend import Endpoint, EndpointKind, Graph, Qos, RosType, Server
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.inbox import Inbox
from pointit.bridges.ros2.routing.outbox import Outbox
from pointit.bridges.ros2.routing.routes import Routes, routes
from pointit.bridges.ros2.routing.site import RosSite
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from tests.support.bench import ManualClock


class Shown:
    """The warnings of a node, and all that it ever had."""

    def __init__(self) -> None:
        self.now: dict[str, str] = {}
        self.ever: list[str] = []

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        self.now[subject or code] = sentence
        self.ever.append(sentence)

    def clear(self, code: str, subject: str = "") -> None:
        self.now.pop(subject or code, None)


class Around(Shown):
    """Surroundings of a driver."""

    def __init__(self, clock: Any = None) -> None:
        super().__init__()
        self.clock = clock or ManualClock()
        self.health = self
        self.metrics: dict[str, float | None] = {}

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        assert unit
        self.metrics[name] = value


class End:
    """One of our ends."""

    def __init__(self, close: Callable[[], None]) -> None:
        self.is_open = True
        self._close = close

    def close(self) -> None:
        if self.is_open:
            self.is_open = False
            self._close()


class Writer(End):
    """Keeps what it was given."""

    is_read = False

    def __init__(self, close: Callable[[], None], sent: list[bytes], *, is_read: bool) -> None:
        super().__init__(close)
        self._sent = sent
        if is_read:
            self.is_read = True

    def put(self, cdr: bytes) -> None:
        assert self.is_open
        self._sent.append(cdr)


@dataclass
class FakeBackend:
    """Endpoints of the bridge in the graph, and those of the test."""

    node: str = "/pointit"
    problem: str = ""
    notes: tuple[str, ...] = ()
    is_read: bool = False
    """Every topic has a reader that the graph does not show."""
    sent: dict[str, list[bytes]] = field(default_factory=dict[str, list[bytes]])
    writers: dict[str, tuple[RosType, Qos]] = field(default_factory=dict[str, tuple[RosType, Qos]])
    readers: dict[str, Callable[[bytes], None]] = field(default_factory=dict[str, Callable[[bytes], None]])
    servers: dict[str, Server] = field(default_factory=dict[str, Server])
    watchers: list[Callable[[Graph], None]] = field(default_factory=list[Callable[[Graph], None]])

    def advertise(self, topic: str, kind: RosType, qos: Qos) -> Writer:
        assert topic not in self.writers
        self.writers[topic] = kind, qos
        sent = self.sent.setdefault(topic, [])
        return Writer(lambda: self._drop(self.writers, topic), sent, is_read=self.is_read)

    def subscribe(self, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]) -> End:
        assert topic not in self.readers, f"{kind} {qos}"
        self.readers[topic] = handler
        return End(lambda: self._drop(self.readers, topic))

    def serve(self, service: str, kind: RosType, server: Server) -> End:
        assert service not in self.servers, kind
        self.servers[service] = server
        return End(lambda: self._drop(self.servers, service))

    async def call(self, service: str, kind: RosType, request: bytes, *, timeout_s: float) -> bytes:
        raise TimeoutError(f"{service} {kind} {request!r} {timeout_s}")

    def watch(self, handler: Callable[[Graph], None]) -> End:
        handler(graph())
        self.watchers.append(handler)
        return End(lambda: self.watchers.remove(handler))

    async def close(self) -> None:
        assert not self.writers
        assert not self.readers
        assert not self.servers

    @staticmethod
    def _drop(named: dict[str, Any], name: str) -> None:
        del named[name]


def graph(*others: tuple[EndpointKind, str], domain: int = 0) -> Graph:
    """Return a graph in which another node, in `domain`, has these ends."""
    kind = RosType(name="std_msgs/msg/Empty", hash="RIHS01_" + "0" * 64)
    ends = [
        Endpoint(kind=end, node="/robot", name=name, type=kind, qos=None, domain=domain)
        for end, name in others
    ]
    return Graph(nodes=frozenset({"/robot"}), endpoints=frozenset(ends))


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Both directions of the bridge between a bus in memory and a graph in which there is only the test."""

    backend: FakeBackend
    bus: ServiceBus
    other: MemoryBus
    """Endpoints on our side."""
    clock: ManualClock
    types: Types
    scene: ConversionState
    outbox: Outbox
    inbox: Inbox

    def heard(self, ros: str, name: str) -> list[Any]:
        """Return the values sent to `ros`, decoded as the type `name`."""
        return [self.types.decode(name, cdr) for cdr in self.backend.sent.get(ros, [])]

    def say(self, ros: str, name: str, /, **fields: Any) -> None:
        """Publish in ROS."""
        self.backend.readers[ros](self.types.encode(name, self.types.make(name, **fields)))

    def look(self, *others: tuple[EndpointKind, str]) -> None:
        """Show the bridge a graph with these ends of another node."""
        seen = graph(*others)
        self.outbox.look(seen)
        self.inbox.on_graph(seen)

    def warnings(self) -> tuple[str, ...]:
        return self.bus.report().warnings


@contextlib.asynccontextmanager
async def bench(types: Types, table: Routes | None = None, *, is_read: bool = False) -> AsyncGenerator[Bench]:
    """Yield the bridge's two halves, wired to fakes."""
    exchange = LocalBroker()
    clock = ManualClock()
    inner = MemoryBus(exchange)
    other = MemoryBus(exchange)
    bus = ServiceBus(inner, clock, "ros2", "ros2")
    backend = FakeBackend(is_read=is_read)
    scene = ConversionState(types)
    site = RosSite(bus=bus, clock=clock, backend=backend, state=scene)
    table = table or routes()
    outbox = Outbox(table.outward, site)
    inbox = Inbox(table.inward, table.served, site)
    made = Bench(
        backend=backend,
        bus=bus,
        other=other,
        clock=clock,
        types=types,
        scene=scene,
        outbox=outbox,
        inbox=inbox,
    )
    try:
        yield made
    finally:
        inbox.close()
        outbox.close()
        await backend.close()
        await bus.close()
        await inner.close()
        await other.close()
