"""Who is in the ROS graph, as rclpy tells."""

import collections
from collections.abc import Sequence

from pointit.bridges.ros2.graph.backend import Endpoint, EndpointKind, Graph, RosType
from pointit.bridges.ros2.over_rclpy.api import EndInfo, NamesAndTypes, Node
from pointit.bridges.ros2.over_rclpy.library import Rclpy

MAX_NODES = 2000
"""Further ones are not looked at."""
WHOLE_EVERY = 4
"""Reads of which one asks for everything, 0.3 ms a topic; the others ask only what everybody has."""

Traits = tuple[tuple[str, tuple[str, ...]], ...]


class GraphReader:
    """Reads the graph, as rclpy tells nobody what has changed in it."""

    def __init__(self, rclpy: Rclpy, node: Node, *, name: str, domain: int) -> None:
        """Begin.

        Args:
            rclpy: the library.
            node: ours.
            name: our node's full name.
            domain: ROS_DOMAIN_ID: rclpy tells nothing of others.
        """
        self._rclpy = rclpy
        self._node = node
        self._name = name
        self._domain = domain
        self._traits: object = None
        self._told: tuple[Graph, int] | None = None
        self._unread = 0
        """Reads since one that asked for everything."""
        self.namesakes = 0
        """Nodes that are called as ours."""

    def read(self) -> Graph | None:
        """Return the graph; none when it and `namesakes` are what they were.

        Who replaces an end by one of another quality of service is seen `WHOLE_EVERY` reads later at most.
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
        if self._told == (graph, self.namesakes):
            return None
        self._told = graph, self.namesakes
        return graph

    def forget(self) -> None:
        """Have the next `read` ask for everything."""
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
        except RuntimeError:  # it has gone meanwhile; the next look does not see it
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
    """Return the hash of an end's type as `RIHS01_…`; empty where it is not told, as before Iron."""
    text = str(getattr(info, "topic_type_hash", ""))
    return text if text.startswith("RIHS01_") else ""


def _traits(names: NamesAndTypes) -> Traits:
    return tuple((name, tuple(types)) for name, types in names)
