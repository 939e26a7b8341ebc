"""A ROS node with parameters: its answers, and a graph without other nodes."""

from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pointit.bridges.ros2.graph.backend import BackendHandle, Endpoint, Graph, RosType
from pointit.bridges.ros2.node_parameters import FIELDS, GET, GET_SUFFIX, LIST, LIST_SUFFIX, MESSAGE, Value
from pointit.bridges.ros2.types.types import Types

NODE = "/pui"
KINDS: Mapping[type, int] = {bool: 1, int: 2, float: 3, str: 4}
LISTS: Mapping[type, int] = {bool: 6, int: 7, float: 8, str: 9}


def message_of(types: Types, value: Value | None) -> Any:
    """Return the message that holds `value`. An empty list is one of numbers.

    Raises:
        ValueError: If ROS has no parameter that holds it.
    """
    if value is None:
        return types.make(MESSAGE)
    is_list = isinstance(value, list)
    kinds: set[type] = {type(value)}
    if isinstance(value, list):
        kinds = {type(item) for item in value} or {float}
    numbers = LISTS if is_list else KINDS
    number = numbers.get(kinds.pop()) if len(kinds) == 1 else None
    if number is None:
        raise ValueError(f"{value!r:.60} is no value that a ROS parameter can have")
    field = {FIELDS[number]: value}
    return types.make(MESSAGE, type=number, **field)


def parameters_of(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the parameters of the valid map `tree`: the opposite of `tree_of`."""
    start = f"{prefix}." if prefix else ""
    parameters: dict[str, Any] = {}
    for section, inside in tree.items():
        for name, entry in _items(inside):
            if section == "bays":
                parameters[f"{start}bays.{name}"] = entry
                continue
            for key, value in entry.items():
                parts = value.items() if isinstance(value, dict) else [("", value)]
                for part, leaf in parts:
                    path = f"{start}{section}.{name}.{key}.{part}"
                    parameters[path.rstrip(".")] = _flat(leaf)
    return parameters


def _items(section: Any) -> Iterable[tuple[Any, Any]]:
    """Return the entries of a section with their names, or their indices in a list."""
    return enumerate(section) if isinstance(section, list) else section.items()


def _flat(value: Any) -> Any:
    """Return lists of points as one list; integers become floats if one number has a fraction."""
    if not isinstance(value, list):
        return value
    numbers: list[Any] = []
    for item in value:
        numbers += item if isinstance(item, list) else [item]
    if float not in map(type, numbers):
        return numbers
    return [float(number) for number in numbers]


class ParameterServer:
    """Parameters in the form in which rclcpp and rclpy nodes report them."""

    def __init__(self, types: Types, parameters: Mapping[str, Any]) -> None:
        self.types = types
        self.parameters = dict(parameters)
        self.asked: list[list[str]] = []
        """Names, by request."""

    def serve(self, backend: Any, node: str) -> list[BackendHandle]:
        """Serve them as `node`."""
        services = {f"{node}{LIST_SUFFIX}": (LIST, self.list), f"{node}{GET_SUFFIX}": (GET, self.get)}
        served: list[Any] = []
        for name, (kind, handler) in services.items():
            served.append(backend.serve(name, self.types.kind(kind), handler))
        return served

    async def list(self, request: bytes) -> bytes:
        query = self.types.decode(self.types.request_of(LIST), request)
        assert list(query.prefixes) == [], "everything"
        assert query.depth == 0, "however deep"
        result = self.types.make("rcl_interfaces/msg/ListParametersResult", names=[*self.parameters])
        return self._encoded(LIST, result=result)

    async def get(self, request: bytes) -> bytes:
        query = self.types.decode(self.types.request_of(GET), request)
        names: list[str] = query.names
        self.asked.append(names)
        values = [message_of(self.types, self.parameters.get(name)) for name in names]
        return self._encoded(GET, values=values)

    def _encoded(self, service: str, **fields: Any) -> bytes:
        response = self.types.response_of(service)
        message = self.types.make(response, **fields)
        return self.types.encode(response, message)


@dataclass
class OneNode:
    """A backend in a graph with one other node, by default `NODE`."""

    server: ParameterServer
    node: str = "/pointit_map"
    problem: str = ""
    name: str = NODE
    domain: int = 0
    hash: str = "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d"
    """Type hash of `ListParameters`."""
    serves: bool = True
    nodes: frozenset[str] = frozenset({"/pointit_map", NODE})
    answers: dict[str, Callable[[bytes], Awaitable[bytes]]] = field(
        default_factory=dict[str, Callable[[bytes], Awaitable[bytes]]]
    )
    """Others than the server's, by service type."""
    watching: int = 0
    is_closed: bool = False

    def graph(self) -> Graph:
        suffix = LIST_SUFFIX if self.serves else "/other"
        service = f"{self.name}{suffix}"
        kind = RosType(name=LIST, hash=self.hash)
        end = Endpoint(kind="server", node=self.name, name=service, type=kind, qos=None, domain=self.domain)
        return Graph(nodes=self.nodes, endpoints=frozenset({end}))

    def watch(self, handler: Callable[[Graph], None]) -> "Watch":
        handler(self.graph())
        return Watch(self)

    async def call(self, service: str, kind: RosType, request: bytes, *, timeout_s: float) -> bytes:
        assert timeout_s > 0
        served = {
            f"{NODE}{LIST_SUFFIX}": (LIST, self.server.list),
            f"{NODE}{GET_SUFFIX}": (GET, self.server.get),
        }
        of, answer = served[service]
        assert kind == self.server.types.kind(of)
        return await self.answers.get(of, answer)(request)

    async def close(self) -> None:
        self.is_closed = True


class Watch:
    """Counts in its node the open watches."""

    def __init__(self, of: OneNode) -> None:
        self._of = of
        of.watching += 1

    def close(self) -> None:
        self._of.watching -= 1
