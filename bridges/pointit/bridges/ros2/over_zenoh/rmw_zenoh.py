"""Our node as `rmw_zenoh_cpp` encodes it on Zenoh, by keys and tokens."""

import itertools

from pointit.bridges.ros2.graph.backend import Endpoint, EndpointKind, Qos, RosType
from pointit.bridges.ros2.message_format import shown
from pointit.bridges.ros2.over_zenoh.graph import Seen
from pointit.bridges.ros2.over_zenoh.token import (
    BRIDGE,
    ENCLAVE,
    EndpointToken,
    NodeToken,
    data_key,
    gid,
    parsed,
    resolved,
)


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
        self._own = NodeToken(
            domain=domain, session=session, node_id=str(next(self._ids)), node=resolved(node), enclave=enclave
        )

    def key(self, name: str, kind: RosType) -> str:
        """Return the key of `name`; other type hashes have other keys."""
        return data_key(self._domain, name, kind)

    def misrouted_keys(self, topic: str) -> str:
        """Return the keys of `topic` in every domain, with every type and hash."""
        return f"*/{resolved(topic)[1:]}/*/*"

    def misrouting_reason(self, key: str, topic: str, kind: RosType) -> str:
        """Return the difference of `key` from ours as a message."""
        if key == self.key(topic, kind):
            return ""
        domain, dds_name, type_hash = key.partition("/")[0], *key.split("/")[-2:]
        nothing = f"messages on {topic} do not reach us"
        if domain != f"{self._domain}":
            return (
                f"{nothing}: they are in domain {shown(domain, 20)}, we are in {self._domain}; "
                f"set domain_id to theirs, or start their node with ROS_DOMAIN_ID={self._domain}"
            )
        if dds_name != kind.dds_name:
            remote_name = shown(dds_name, 80)
            return f"{nothing}: they are {remote_name}, not {kind.dds_name}; rename one of the two topics"
        return (
            f"{nothing}: their {kind.name} has the hash {shown(type_hash, 20)}, ours {kind.hash[:20]}; "
            "rebuild its package there, or set distro to theirs"
        )

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
        found = parsed(token)
        if not isinstance(found, EndpointToken):
            return Seen(node=found.node, domain=found.domain)
        is_ours = found.session == self._own.session
        is_bridge = self._own.enclave == found.enclave == BRIDGE and not is_ours
        endpoint = Endpoint(
            kind=found.kind,
            node=found.node,
            name=found.name,
            type=found.type,
            qos=found.qos,
            domain=found.domain,
            is_ours=is_ours,
            is_bridge=is_bridge,
        )
        origin = gid(token) if is_bridge else None
        return Seen(node=found.node, domain=found.domain, endpoint=endpoint, bridge_gid=origin)
