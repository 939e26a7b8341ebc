"""The graph that the liveliness tokens of rmw_zenoh describe, and the codec of one session of ours."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pointit.bridges.ros2.graph.backend import Endpoint, EndpointKind, Graph, Qos, RosType
from pointit.bridges.ros2.over_zenoh.token import ENCLAVE, EndpointToken, NodeToken, data_key, gid, parsed

BRIDGE = "/pointit/bridge"
"""Enclave of PointIt bridges, by which they recognize each other whatever their nodes' names."""

MAX_TOKENS = 20_000
"""Maximum number of stored foreign tokens; further ones are ignored."""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """Content of a token: a node, or one of its endpoints with `endpoint`."""

    node: str
    domain: int
    endpoint: Endpoint | None = None
    bridge_gid: bytes | None = None
    """Gid in messages of this endpoint if it is another PointIt's."""


class LivelinessDirectory:
    """The tokens that are alive."""

    def __init__(self, read: Callable[[str], Seen], domain: int, on_change: Callable[[], None]) -> None:
        """Create an empty graph.

        Args:
            read: parses a token; raises `ValueError` if it cannot.
            domain: our ROS_DOMAIN_ID.
            on_change: called when the graph has changed.
        """
        self._read = read
        self._on_change = on_change
        self._domain = domain
        self._seen: dict[str, Seen] = {}
        self._own: set[str] = set()
        self.bridged: set[bytes] = set()
        """Gids in messages of other PointIts, of any domain."""

    def announce(self, token: str) -> None:
        """Add a token of ours. It stays even if others report its end, as lost routers do."""
        self._own.add(token)
        self.change({token: True})

    def retract(self, token: str) -> None:
        """Remove a token of ours."""
        self._own.discard(token)
        self.change({token: False})

    def change(self, tokens: Mapping[str, bool]) -> None:
        """Add tokens (True) or remove them (False)."""
        has_changed = False
        for token, present in tokens.items():
            if not present and token in self._own:
                continue
            if not present:
                ended = self._seen.pop(token, None)
                if ended is not None:
                    has_changed = True
                    self.bridged -= {ended.bridge_gid}
            elif token not in self._seen and len(self._seen) < MAX_TOKENS:
                try:
                    seen = self._read(token)
                except ValueError:
                    continue
                self._seen[token] = seen
                has_changed = True
                if seen.bridge_gid is not None:
                    self.bridged.add(seen.bridge_gid)
        if has_changed:
            self._on_change()

    def graph(self) -> Graph:
        """Return the graph: the nodes of our domain, the endpoints of every domain."""
        nodes: set[str] = set()
        endpoints: set[Endpoint] = set()
        for seen in self._seen.values():
            if seen.domain == self._domain:
                nodes.add(seen.node)
            if seen.endpoint is not None:
                endpoints.add(seen.endpoint)
        return Graph(nodes=frozenset(nodes), endpoints=frozenset(endpoints))


class RmwZenoh:
    """Encoder and decoder for one session of ours with one node; numbers its entities."""

    def __init__(self, *, session: str, node: str, domain: int, enclave: str = ENCLAVE) -> None:
        """Create the context with the node.

        Args:
            session: Zenoh's id of the session.
            node: our node's full name.
            domain: ROS_DOMAIN_ID.
            enclave: enclave of our node. `BRIDGE` for one that other bridges recognise.

        Raises:
            ValueError: If `node` is no full ROS name.
        """
        self._domain = domain
        self._ids = itertools.count()
        node_id = str(next(self._ids))
        self._own = NodeToken(domain=domain, session=session, node_id=node_id, node=node, enclave=enclave)

    def key(self, name: str, kind: RosType) -> str:
        """Return the key of `name`; other type hashes have other keys."""
        return data_key(self._domain, name, kind)

    def node_token(self) -> str:
        """Return our node's token."""
        return self._own.text

    def endpoint_token(self, kind: EndpointKind, name: str, of: RosType, qos: Qos) -> str:
        """Return the token of a new endpoint: 13 chunks, so Lyrical sends it whole messages, not buffers."""
        endpoint_id = str(next(self._ids))
        return EndpointToken(
            **vars(self._own), endpoint_id=endpoint_id, kind=kind, name=name, type=of, qos=qos
        ).text

    def read(self, token: str) -> Seen:
        """Return the content of a foreign token.

        Raises:
            ValueError: If it is none.
        """
        content = parsed(token)
        if not isinstance(content, EndpointToken):
            return Seen(node=content.node, domain=content.domain)
        is_ours = content.session == self._own.session
        is_bridge = self._own.enclave == content.enclave == BRIDGE and not is_ours
        endpoint = Endpoint(
            kind=content.kind,
            node=content.node,
            name=content.name,
            type=content.type,
            qos=content.qos,
            domain=content.domain,
            is_ours=is_ours,
            is_bridge=is_bridge,
        )
        origin = gid(token) if is_bridge else None
        return Seen(node=content.node, domain=content.domain, endpoint=endpoint, bridge_gid=origin)
