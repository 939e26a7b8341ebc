"""A ROS node with parameters: its answers, and a graph without other nodes."""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pointit.bridges.ros2.graph.backend import Closable, Endpoint, Graph, RosType
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
    kinds: set[type] = {type(each) for each in value} or {float} if isinstance(value, list) else {type(value)}
    known = LISTS if isinstance(value, list) else KINDS
    kind = known.get(kinds.pop()) if len(kinds) == 1 else None
    if kind is None:
        raise ValueError(f"{value!r:.60} is no value that a ROS parameter can have")
    return types.make(MESSAGE, type=kind, **{FIELDS[kind]: value})


def parameters_of(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the parameters of the valid map `tree`: the opposite of `tree_of`."""
    start = f"{prefix}." if prefix else ""
    parameters: dict[str, Any] = {}
    for section, inside in tree.items():
        for name, entry in enumerate(inside) if isinstance(inside, list) else inside.items():
            if section == "bays":
                parameters[f"{start}bays.{name}"] = entry
                continue
            for key, value in entry.items():
                for part, each in value.items() if isinstance(value, dict) else [("", value)]:
                    parameters[f"{start}{section}.{name}.{key}.{part}".rstrip(".")] = _flat(each)
    return parameters


def _flat(value: Any) -> Any:
    """Return lists of points as one list; integers become floats if one number has a fraction."""
    if not isinstance(value, list):
        return value
    numbers = [number for each in value for number in (each if isinstance(each, list) else [each])]
    return [float(number) for number in numbers] if float in map(type, numbers) else numbers


class ParameterServer:
    """Parameters in the form in which rclcpp and rclpy nodes report them."""

    def __init__(self, types: Types, parameters: Mapping[str, Any]) -> None:
        self.types = types
        self.parameters = dict(parameters)
        self.asked: list[list[str]] = []
        """Names, by request."""

    def serve(self, backend: Any, node: str) -> list[Closable]:
        """Serve them as `node`."""
        return [
            backend.serve(f"{node}{LIST_SUFFIX}", self.types.kind(LIST), self.list),
            backend.serve(f"{node}{GET_SUFFIX}", self.types.kind(GET), self.get),
        ]

    async def list(self, request: bytes) -> bytes:
        asked = self.types.decode(self.types.request_of(LIST), request)
        assert (list(asked.prefixes), asked.depth) == ([], 0), "everything, however deep"
        result = self.types.make("rcl_interfaces/msg/ListParametersResult", names=[*self.parameters])
        return self._encoded(LIST, result=result)

    async def get(self, request: bytes) -> bytes:
        names: list[str] = self.types.decode(self.types.request_of(GET), request).names
        self.asked.append(names)
        values = [message_of(self.types, self.parameters.get(name)) for name in names]
        return self._encoded(GET, values=values)

    def _encoded(self, service: str, **fields: Any) -> bytes:
        response = self.types.response_of(service)
        return self.types.encode(response, self.types.make(response, **fields))


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
        service = f"{self.name}{LIST_SUFFIX}" if self.serves else f"{self.name}/other"
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
