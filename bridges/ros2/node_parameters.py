"""Parameters of another node, by the services that every ROS node has.

No core: it waits for another node.
"""

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any, cast

from pointit.bridges.ros2.graph.backend import Backend, Endpoint, Graph
from pointit.bridges.ros2.message_format import MAX_NAME
from pointit.bridges.ros2.types.types import NO_HASH, Types
from pointit.runtime.errors import NoAnswerError
from pointit.schemas.printable import is_printable
from pointit.schemas.text import first_of, one_line

Value = bool | int | float | str | list[Any]
"""A list holds values of one of the other types: ROS has no lists of lists."""

MESSAGE = "rcl_interfaces/msg/ParameterValue"
NOT_SET = 0
FIELDS: Mapping[int, str] = {
    1: "bool_value",
    2: "integer_value",
    3: "double_value",
    4: "string_value",
    5: "byte_array_value",
    6: "bool_array_value",
    7: "integer_array_value",
    8: "double_array_value",
    9: "string_array_value",
}
"""Field of the value by `rcl_interfaces/msg/ParameterType`; all other fields are unused."""

LIST = "rcl_interfaces/srv/ListParameters"
GET = "rcl_interfaces/srv/GetParameters"
LIST_SUFFIX = "/list_parameters"
"""End of the name of the service that lists parameters, after the node's name."""
GET_SUFFIX = "/get_parameters"
"""The same of the service that gets them."""

PAGE = 16
"""Number of parameters per request: a line of a map may have a thousand points."""
MAX_SHOWN = 20
"""Maximum number of names in a message."""


def value_of(message: Any) -> Value | None:
    """Return the value of a decoded message, or None if the parameter has none.

    Raises:
        ValueError: If it says that it is of a kind that there is not.
    """
    kind = int(message.type)
    if kind == NOT_SET:
        return None
    if kind not in FIELDS:
        kinds = f"{NOT_SET} to {max(FIELDS)}"
        raise ValueError(f"a parameter is of kind {kind}, and there are {kinds}")
    value: Any = getattr(message, FIELDS[kind])
    if isinstance(value, bool | int | float | str):
        return value
    elements = value.tolist() if hasattr(value, "tolist") else list(value)
    return cast("list[Any]", elements)


class NodeParameters:
    """The parameters of one node."""

    def __init__(
        self,
        backend: Backend,
        types: Types,
        node: str,
        *,
        domain: int,
        appears_s: float,
        timeout_s: float,
        needs: str = "",
    ) -> None:
        """Create it without requests.

        Args:
            backend: us in the graph.
            types: of the distribution of the others.
            node: its full name.
            domain: ours.
            appears_s: time to wait until it is seen.
            timeout_s: timeout of one answer.
            needs: conditions for other nodes to be seen, as text.
        """
        self._backend = backend
        self._types = types
        self._node = node
        self._domain = domain
        self._appears_s = appears_s
        self._timeout_s = timeout_s
        self._needs = needs

    async def names(self) -> list[str]:
        """Return the names of its parameters in its order, without names that no map uses.

        Raises:
            NoAnswerError: If it is absent (names those present), serves no parameters, or answers too late.
        """
        await self._on_presence()
        response = await self._ask(LIST, LIST_SUFFIX, prefixes=[], depth=0)
        names = dict.fromkeys(response.result.names)
        return [name for name in names if is_printable(name)]

    async def values(self, names: Sequence[str]) -> dict[str, Value]:
        """Return the parameters `names` that have a value, in that order.

        Raises:
            NoAnswerError: If the node does not answer in time, or if its answer does not fit.
        """
        values: dict[str, Value] = {}
        for first in range(0, len(names), PAGE):
            page = names[first : first + PAGE]
            response = await self._ask(GET, GET_SUFFIX, names=list(page))
            count = len(response.values)
            if count != len(page):
                raise NoAnswerError(
                    f"node {self._node} was asked for {len(page)} parameters and told "
                    f"{count}; try again, one may have been taken away meanwhile"
                )

            # The answer has no names: values come in the order of the request
            for name, message in zip(page, response.values, strict=True):
                try:
                    value = value_of(message)
                except ValueError as error:
                    sentence = f"{name} of node {self._node}: {error}"
                    raise NoAnswerError(sentence) from error
                if value is not None:
                    values[name] = value
        return values

    async def _on_presence(self) -> None:
        """Wait until the node is seen to serve its parameters by our definitions."""
        graph = Graph(nodes=frozenset(), endpoints=frozenset())
        changed = asyncio.Event()

        def on_graph(seen: Graph) -> None:
            nonlocal graph
            graph = seen
            changed.set()

        watch = self._backend.watch(on_graph)
        try:
            async with asyncio.timeout(self._appears_s):
                while not self._servers(graph):
                    changed.clear()
                    await changed.wait()
        except TimeoutError:
            raise NoAnswerError(self._absence(graph)) from None
        finally:
            watch.close()

        # A server of another definition, so of another type hash, would never answer
        hashes = {server.type.hash for server in self._servers(graph)} - {""}
        own_hash = self._types.kind(LIST).hash
        if hashes and own_hash not in hashes:
            problem = _other_distro(hashes, self._types)
            raise NoAnswerError(f"node {self._node} {problem}")

    def _servers(self, graph: Graph) -> list[Endpoint]:
        service = f"{self._node}{LIST_SUFFIX}"
        return [server for server in _list_servers(graph, self._domain) if server.name == service]

    def _absence(self, graph: Graph) -> str:
        """Return a message why there is no node to query, with its remedy."""
        names = _nodes(graph, self._domain) - {self._backend.node}
        if self._node in names:
            return (
                f"node {self._node} serves no parameters; start it with its parameter services, or give its "
                "map as a file"
            )
        if not names:
            reason = self._backend.problem or self._needs
            if reason:
                reason = f": {reason}"
            return f"no ROS node is seen in domain {self._domain}{reason}"
        lines = (one_line(name, MAX_NAME) for name in sorted(names))
        others = first_of(lines, MAX_SHOWN)
        return f"there is no node {self._node} in domain {self._domain}; there are {others}"

    async def _ask(self, service: str, suffix: str, **fields: Any) -> Any:
        types = self._types
        request = types.request_of(service)
        try:
            message = types.make(request, **fields)
            cdr = await self._backend.call(
                f"{self._node}{suffix}",
                types.kind(service),
                types.encode(request, message),
                timeout_s=self._timeout_s,
            )
        except TimeoutError as error:
            raise NoAnswerError(f"{error}") from error
        try:
            return types.decode(types.response_of(service), cdr)
        except ValueError as error:
            raise NoAnswerError(f"what node {self._node} answered cannot be read: {error}") from error


def _list_servers(graph: Graph, domain: int) -> list[Endpoint]:
    """Return the servers that list the parameters of their node, of all nodes in `domain`."""
    servers = [endpoint for endpoint in graph.within(domain).endpoints if endpoint.kind == "server"]
    return [server for server in servers if server.name.endswith(LIST_SUFFIX)]


def _nodes(graph: Graph, domain: int) -> set[str]:
    """Return the nodes present. Bridges to DDS announce services only."""
    names = {name for name in graph.nodes if name.startswith("/")}
    for server in _list_servers(graph, domain):
        names.add(server.name.removesuffix(LIST_SUFFIX))
    return names


def _other_distro(hashes: set[str], types: Types) -> str:
    if NO_HASH in hashes:
        return f"is of Humble, whose services no node of {types.distro} can ask; set distro to humble"
    if types.distro == "humble":
        return "is not of Humble; set distro to theirs (jazzy, kilted, …)"
    return f"has another definition of {LIST} than {types.distro}; set distro to theirs"
