"""Nodes and endpoints in the ROS graph, as seen by rclpy."""

import collections
from collections.abc import Sequence

from pointit.bridges.ros2.graph.backend import Endpoint, EndpointKind, Graph, RosType
from pointit.bridges.ros2.over_rclpy.rclpy_library import Rclpy
from pointit.bridges.ros2.over_rclpy.rclpy_types import EndInfo, NamesAndTypes, Node

MAX_NODES = 2000
"""Maximum number of nodes read."""
WHOLE_EVERY = 4
"""One of this many reads asks for everything, 0.3 ms a topic; the others ask only for lists of names."""

Traits = tuple[tuple[str, tuple[str, ...]], ...]


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
        topics = _traits(self._node.get_topic_names_and_types())
        nodes = [tuple(each) for each in self._node.get_node_names_and_namespaces()[:MAX_NODES]]
        counts = collections.Counter(full_name(name, namespace) for name, namespace in nodes)
        held = {full_name(*node): self._held(*node) for node in dict.fromkeys(nodes)}
        traits = (topics, sorted(counts.items()), sorted(held.items()))
        self._unread += 1
        if traits == self._traits and self._unread < WHOLE_EVERY:
            return None
        self._unread = 0
        self._traits = traits
        self.namesakes = max(counts[self._name] - 1, 0)
        endpoints: set[Endpoint] = set()
        for topic, _ in topics:
            endpoints.update(self._ends("publisher", topic, self._node.get_publishers_info_by_topic(topic)))
            endpoints.update(
                self._ends("subscriber", topic, self._node.get_subscriptions_info_by_topic(topic))
            )
        for node, (_, _, services, clients) in held.items():
            endpoints.update(self._services("server", node, services))
            endpoints.update(self._services("client", node, clients))
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
            return (
                _traits(node.get_publisher_names_and_types_by_node(name, namespace)),
                _traits(node.get_subscriber_names_and_types_by_node(name, namespace)),
                _traits(node.get_service_names_and_types_by_node(name, namespace)),
                _traits(node.get_client_names_and_types_by_node(name, namespace)),
            )
        except RuntimeError:  # it has gone meanwhile; the next read does not see it
            return ((), (), (), ())

    def _ends(self, kind: EndpointKind, topic: str, infos: Sequence[EndInfo]) -> list[Endpoint]:
        return [
            self._endpoint(
                kind,
                full_name(info.node_name, info.node_namespace),
                topic,
                RosType(name=info.topic_type, hash=hash_of(info)),
                info,
            )
            for info in infos
            if info.topic_type.count("/") == 2
        ]

    def _services(self, kind: EndpointKind, node: str, services: Traits) -> list[Endpoint]:
        return [
            self._endpoint(kind, node, service, RosType(name=name, hash=""))
            for service, names in services
            for name in names
            if name.count("/") == 2
        ]

    def _endpoint(
        self, kind: EndpointKind, node: str, name: str, of: RosType, info: EndInfo | None = None
    ) -> Endpoint:
        return Endpoint(
            kind=kind,
            node=node,
            name=name,
            type=of,
            qos=None if info is None else self._rclpy.qos(info.qos_profile),
            domain=self._domain,
            is_ours=node == self._name,
        )


def full_name(name: str, namespace: str) -> str:
    """Return a node's full name."""
    return f"{namespace.rstrip('/')}/{name}"


def hash_of(info: EndInfo) -> str:
    """Return the hash of an endpoint's type as `RIHS01_…`, or `""` if unknown, as before Iron."""
    text = str(getattr(info, "topic_type_hash", ""))
    return text if text.startswith("RIHS01_") else ""


def _traits(names: NamesAndTypes) -> Traits:
    return tuple((name, tuple(types)) for name, types in names)
