"""A stand-in for rclpy: nodes in this process that hear each other, an executor that is a queue, and us.

What the genuine one does that matters here: publishers hear themselves, requests are read on the executor's
thread and what fails there comes out of `spin`, and a callback's response is sent by `send_response`.
"""

import functools
import queue
import sys
import threading
import time
import types
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, TypeVar

import pytest

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import Graph, Qos, RosType
from pointit.bridges.ros2.graph.backends import opened
from pointit.bridges.ros2.over_rclpy import backend as rclpy_backend
from pointit.bridges.ros2.over_rclpy.backend import RclpyBackend
from tests.unit.ros2.graph_of_one import Shown

E = TypeVar("E", bound="End")


class Reliability(Enum):
    RELIABLE = 1
    BEST_EFFORT = 2


class Durability(Enum):
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


@dataclass
class Profile:
    depth: int
    reliability: Reliability
    durability: Durability
    lifespan: object = None


@dataclass
class Duration:
    nanoseconds: int


class Value:
    """A message: its CDR."""

    def __init__(self, cdr: bytes = b"\0\1\0\0\0") -> None:
        self.cdr = cdr


class Bool(Value):
    TYPE = "std_msgs/msg/Bool"
    HASH: ClassVar[str] = "RIHS01_" + "b" * 64


class SetBool:
    TYPE = "std_srvs/srv/SetBool"

    class Request(Value):
        pass

    class Response(Value):
        pass


@dataclass
class Info:
    node_name: str
    node_namespace: str
    topic_type: str
    topic_type_hash: str
    qos_profile: Profile


@dataclass(eq=False)
class End:
    node: "Node"
    kind: Any
    name: str
    profile: Profile | None = None
    callback: Any = None

    def publish(self, msg: bytes) -> None:
        if b"refuse" in msg:
            raise RuntimeError("it was refused\nby rcl")
        for end in [*self.node.wire.ends["subscription"]]:
            if end.name == self.name:
                info = {"source_timestamp": time.time_ns()}
                end.node.run(functools.partial(end.callback, msg + b"\0\0\0", info))


class Service(End):
    is_mute = False

    def send_response(self, response: Value, header: Any) -> None:
        assert isinstance(response, Value)
        if not self.is_mute:
            header(response)

    def ask(self, cdr: bytes, header: Any) -> None:
        def take() -> None:
            if b"bad" in cdr:
                raise RuntimeError("cannot be read")
            response = self.callback(SetBool.Request(cdr), SetBool.Response())
            self.send_response(response, header)

        self.node.run(take)


class Reply:
    def __init__(self, node: "Node") -> None:
        self._node = node
        self._value = Value()

    def add_done_callback(self, callback: Any) -> None:
        self._callback = callback

    def result(self) -> Value:
        return self._value

    def arrive(self, value: Value) -> None:
        self._value = value
        self._node.run(lambda: self._callback(self))


class Client(End):
    def service_is_ready(self) -> bool:
        return any(end.name == self.name for end in self.node.wire.ends["service"])

    def call_async(self, request: Value) -> Reply:
        reply = Reply(self.node)
        server = next(end for end in self.node.wire.ends["service"] if end.name == self.name)
        assert isinstance(server, Service)
        server.ask(request.cdr, reply.arrive)
        return reply

    def remove_pending_request(self, future: Reply) -> None:
        self.node.wire.removed.append(future)


@dataclass(eq=False)
class Wire:
    """Everybody who is there."""

    nodes: list["Node"] = field(default_factory=list["Node"])
    ends: dict[str, list[End]] = field(
        default_factory=lambda: {"publisher": [], "subscription": [], "service": [], "client": []}
    )
    removed: list[Reply] = field(default_factory=list[Reply])

    def node(self, name: str, namespace: str = "/") -> "Node":
        """Return a node of somebody else, whose callbacks run at once."""
        return Node(name, namespace=namespace, context=Context(self))


class Node:
    def __init__(self, name: str, *, namespace: str, context: "Context", **options: Any) -> None:
        if name == "refused":
            raise RuntimeError("no middleware\nat all")
        self.name = name
        self.namespace = namespace
        self.wire = context.wire
        self.options = options
        self.executor: Executor | None = None
        self.wire.nodes.append(self)

    def run(self, work: Callable[[], None]) -> None:
        if self.executor is None:
            work()
        else:
            self.executor.create_task(work)

    def _add(self, kind: str, end: E) -> E:
        self.wire.ends[kind].append(end)
        return end

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: Profile) -> End:
        return self._add("publisher", End(self, msg_type, topic, qos_profile))

    def create_subscription(
        self, kind: Any, topic: str, callback: Any, profile: Profile, *, raw: bool
    ) -> End:
        assert raw
        return self._add("subscription", End(self, kind, topic, profile, callback))

    def create_service(self, srv_type: Any, srv_name: str, callback: Any) -> Service:
        return self._add("service", Service(self, srv_type, srv_name, callback=callback))

    def create_client(self, srv_type: Any, srv_name: str) -> Client:
        return self._add("client", Client(self, srv_type, srv_name))

    def _remove(self, end: End) -> bool:
        for ends in self.wire.ends.values():
            if end in ends:
                ends.remove(end)
                return True
        return False

    destroy_publisher = destroy_subscription = destroy_service = destroy_client = _remove

    def destroy_node(self) -> None:
        self.wire.nodes.remove(self)
        for kind, ends in self.wire.ends.items():
            self.wire.ends[kind] = [end for end in ends if end.node is not self]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(node.name, node.namespace) for node in self.wire.nodes]

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        ends = [*self.wire.ends["publisher"], *self.wire.ends["subscription"]]
        return [(name, [Bool.TYPE]) for name in sorted({end.name for end in ends})]

    def _of(self, kind: str, name: str, namespace: str) -> list[tuple[str, list[str]]]:
        if not any((node.name, node.namespace) == (name, namespace) for node in self.wire.nodes):
            raise RuntimeError("no such node")
        ends = [
            end for end in self.wire.ends[kind] if (end.node.name, end.node.namespace) == (name, namespace)
        ]
        return [(end.name, [end.kind.TYPE]) for end in ends]

    get_publisher_names_and_types_by_node = functools.partialmethod(_of, "publisher")
    get_subscriber_names_and_types_by_node = functools.partialmethod(_of, "subscription")
    get_service_names_and_types_by_node = functools.partialmethod(_of, "service")
    get_client_names_and_types_by_node = functools.partialmethod(_of, "client")

    def _infos(self, kind: str, topic: str) -> list[Info]:
        return [
            Info(end.node.name, end.node.namespace, end.kind.TYPE, end.kind.HASH, end.profile)
            for end in self.wire.ends[kind]
            if end.name == topic and end.profile is not None
        ]

    get_publishers_info_by_topic = functools.partialmethod(_infos, "publisher")
    get_subscriptions_info_by_topic = functools.partialmethod(_infos, "subscription")


class Context:
    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self._is_up = False

    def init(self, args: list[str], *, initialize_logging: bool, domain_id: int) -> None:
        assert (args, initialize_logging) == ([], False)
        assert domain_id >= 0
        self._is_up = True

    def ok(self) -> bool:
        return self._is_up

    def try_shutdown(self) -> None:
        self._is_up = False


class Executor:
    def __init__(self, *, context: Context) -> None:
        self.context = context
        self._work: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._is_down = False

    def add_node(self, node: Node) -> bool:
        node.executor = self
        return True

    def create_task(self, callback: Callable[[], None]) -> None:
        self._work.put(callback)

    def spin(self) -> None:
        while not self._is_down and self.context.ok():
            work = self._work.get()
            if work is not None:
                work()

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        self._is_down = True
        self._work.put(None)
        return timeout_sec == 0.0


def serialize(value: Value) -> bytes:
    return value.cdr


def deserialize(cdr: bytes, kind: type[Value]) -> Value:
    if b"bad" in cdr:
        raise RuntimeError("cannot be read")
    return kind(cdr)


def installed(monkeypatch: pytest.MonkeyPatch) -> Wire:
    """Put it where Python finds rclpy, with the types that it knows."""
    wire = Wire()
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.context": {"Context": lambda: Context(wire)},
        "rclpy.duration": {"Duration": Duration},
        "rclpy.executors": {"SingleThreadedExecutor": Executor},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {
            "QoSProfile": Profile,
            "ReliabilityPolicy": Reliability,
            "DurabilityPolicy": Durability,
        },
        "rclpy.serialization": {"serialize_message": serialize, "deserialize_message": deserialize},
        "rclpy.subscription": {"Subscription": type("Subscription", (), {"CallbackType": None})},
        "std_msgs": {},
        "std_msgs.msg": {"Bool": Bool},
        "std_srvs": {},
        "std_srvs.srv": {"SetBool": SetBool},
    }
    for name, contents in modules.items():
        module = types.ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    return wire


BOOL = RosType(name="std_msgs/msg/Bool", hash=Bool.HASH)
SET = RosType(name="std_srvs/srv/SetBool", hash="RIHS01_" + "5" * 64)
QOS = Qos(depth=10)
TRUE = b"\0\1\0\0\1"
PADDED = TRUE + b"\0\0\0"


class Ours(Shown):
    """A node of ours, and what it says."""

    backend: RclpyBackend

    def __init__(self) -> None:
        super().__init__()
        self.graphs: list[Graph] = []

    def sees(self, kind: str, name: str) -> bool:
        ends = self.graphs[-1].endpoints
        return any((each.kind, each.name, each.is_ours) == (kind, name, False) for each in ends)


@asynccontextmanager
async def node_of_ours(**settings: Any) -> AsyncGenerator[Ours]:
    ours = Ours()
    config = BackendConfig.model_validate({"kind": "dds", "node": "/site1/pointit", **settings})
    backend = await opened(config, ours)
    assert isinstance(backend, RclpyBackend)
    ours.backend = backend
    backend.watch(ours.graphs.append)
    try:
        yield ours
    finally:
        await backend.close()
        assert not [each for each in threading.enumerate() if each.name == "rclpy-spin"]


def on_a_wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    """Install the stand-in, in a terminal that says nothing of ROS; the graph is looked at often."""
    for variable in ("ROS_DOMAIN_ID", "ROS_DISTRO"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(rclpy_backend, "LOOK_S", 0.02)
    return installed(monkeypatch)


def profile(*, latched: bool = False) -> Profile:
    kept = Durability.TRANSIENT_LOCAL if latched else Durability.VOLATILE
    return Profile(10, Reliability.RELIABLE, kept)
