"""Liveliness tokens of rmw_zenoh, by which nodes and their endpoints say that they are there.

    node      @ros2_lv/<domain>/<session>/<node id>/<node id>/NN/<enclave>/<namespace>/<node>
    endpoint  @ros2_lv/<domain>/<session>/<node id>/<id>/<MP|MS|SS|SC>/<enclave>/<namespace>/<node>
                      /<name>/<type>/<hash>/<qos>

Names have `%` for `/`. Lyrical and later may add a chunk; more are read over.
"""

import re
from dataclasses import dataclass

import xxhash

from pointit.bridges.ros2.graph.backend import EndpointKind, Qos, RosType
from pointit.bridges.ros2.over_zenoh.keys import PRESENCE, dds_type, resolved
from pointit.bridges.ros2.over_zenoh.qos import qos_of, qos_text

NODE = "NN"
CODES: dict[EndpointKind, str] = {"publisher": "MP", "subscriber": "MS", "server": "SS", "client": "SC"}
KINDS: dict[str, EndpointKind] = {code: kind for kind, code in CODES.items()}

ENCLAVE = "/"
"""Of nodes that do not run under SROS 2."""
BRIDGE = "/pointit/bridge"
"""The enclave that bridges of PointIt name, by which they know each other, however their nodes are called."""

NODE_CHUNKS, ENDPOINT_CHUNKS = 9, 13

MAX_CHARACTERS = 4096
"""Far above what names of the longest that ROS allows need."""

DIGITS = re.compile(r"[0-9]{1,18}", re.ASCII)
SESSION = re.compile(r"[0-9a-f]{1,32}")


@dataclass(frozen=True, kw_only=True)
class NodeToken:
    """What a node says of itself."""

    domain: int
    session: str
    """Zenoh's id of it: up to 32 hexadecimal digits."""
    node_id: str
    """Tells the entities of a session apart; rmw_zenoh counts them, nodes and endpoints alike."""
    node: str
    """Its full name: `/user1/belt`."""
    enclave: str = ENCLAVE

    @property
    def text(self) -> str:
        """Return the token.

        Raises:
            ValueError: the name is no full ROS name.
        """
        return self._chunks(self.node_id, NODE)

    def _chunks(self, entity_id: str, code: str) -> str:
        namespace, _, name = resolved(self.node).rpartition("/")
        ids = f"{PRESENCE}/{self.domain}/{self.session}/{self.node_id}/{entity_id}"
        return f"{ids}/{code}/{mangled(self.enclave)}/{mangled(namespace)}/{name}"


@dataclass(frozen=True, kw_only=True)
class EndpointToken(NodeToken):
    """What a node says of one of its endpoints."""

    endpoint_id: str
    kind: EndpointKind
    name: str
    """Of the topic or service, resolved."""
    type: RosType
    qos: Qos

    @property
    def text(self) -> str:
        """Return the token.

        Raises:
            ValueError: a name is no full ROS name.
        """
        node = self._chunks(self.endpoint_id, CODES[self.kind])
        name = mangled(resolved(self.name))
        return f"{node}/{name}/{self.type.dds_name}/{self.type.hash}/{qos_text(self.qos)}"

    @property
    def gid(self) -> bytes:
        """Return the 16 bytes by which everybody knows the endpoint; peers compute them from the token."""
        return gid(self.text)


def parsed(text: str) -> NodeToken | EndpointToken:
    """Return what a token of anybody says; chunks after the thirteenth are read over.

    The text of what is returned need not be `text`: hash that for the gid of somebody else's endpoint.

    Raises:
        ValueError: it is no such token.
    """
    chunks = text.split("/", ENDPOINT_CHUNKS) if len(text) <= MAX_CHARACTERS else []
    if len(chunks) < NODE_CHUNKS or chunks[0] != PRESENCE or not all(chunks):
        raise ValueError(f"{text[:100]!r} is not a token of a ROS node")
    _, domain, session, node_id, entity_id, code, enclave, namespace, name = chunks[:NODE_CHUNKS]
    if not SESSION.fullmatch(session) or not DIGITS.fullmatch(domain):
        raise ValueError(f"{text[:100]!r} has a domain or session that is none")
    node = resolved(f"{unmangled(namespace).rstrip('/')}/{name}")
    if code == NODE:
        return NodeToken(
            domain=int(domain), session=session, node_id=node_id, node=node, enclave=unmangled(enclave)
        )
    if code not in KINDS or len(chunks) < ENDPOINT_CHUNKS:
        raise ValueError(f"{text[:100]!r} is neither of a node nor of an endpoint")
    topic, dds_name, type_hash, qos = chunks[NODE_CHUNKS:ENDPOINT_CHUNKS]
    return EndpointToken(
        domain=int(domain),
        session=session,
        node_id=node_id,
        node=node,
        enclave=unmangled(enclave),
        endpoint_id=entity_id,
        kind=KINDS[code],
        name=resolved(unmangled(topic)),
        type=dds_type(dds_name, type_hash),
        qos=qos_of(qos),
    )


def mangled(name: str) -> str:
    """Return a name as one chunk; the root is `%`."""
    return name.replace("/", "%") or "%"


def unmangled(chunk: str) -> str:
    """Return the name in a chunk."""
    return chunk.replace("%", "/")


def gid(token: str) -> bytes:
    """Return the 16 bytes by which everybody knows the endpoint with this token: its XXH3, little endian."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")
