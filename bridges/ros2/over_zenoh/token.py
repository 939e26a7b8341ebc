"""Keys and liveliness tokens of rmw_zenoh.

    node      @ros2_lv/<domain>/<session>/<node id>/<node id>/NN/<enclave>/<namespace>/<node>
    endpoint  @ros2_lv/<domain>/<session>/<node id>/<id>/<MP|MS|SS|SC>/<enclave>/<namespace>/<node>
              /<name>/<type>/<hash>/<qos>

Names have `%` for `/`. Lyrical and later may add a chunk; further chunks are ignored.
"""

import re
from dataclasses import dataclass

import xxhash

from pointit.bridges.ros2.graph.backend import EndpointKind, Qos, RosType
from pointit.bridges.ros2.over_zenoh.qos_text import qos_of, qos_text

PRESENCE = "@ros2_lv"
"""First chunk of the tokens of nodes and their endpoints."""

EVERY_TOKEN = f"{PRESENCE}/**"

NAME = re.compile(r"(?:/[A-Za-z_][A-Za-z0-9_]*)+")
DDS_TYPE = re.compile(r"(\w+)::(\w+)::dds_::(\w+)_", re.ASCII)
HASH = re.compile(r"\w+", re.ASCII)

NODE = "NN"
CODES: dict[EndpointKind, str] = {"publisher": "MP", "subscriber": "MS", "server": "SS", "client": "SC"}
KINDS: dict[str, EndpointKind] = {code: kind for kind, code in CODES.items()}

ENCLAVE = "/"
"""Enclave of nodes that do not run under SROS 2."""

NODE_CHUNKS = 9
ENDPOINT_CHUNKS = 13

MAX_CHARACTERS = 4096
"""Maximum length, far above that of the longest names in ROS."""

DIGITS = re.compile(r"[0-9]{1,18}", re.ASCII)
SESSION = re.compile(r"[0-9a-f]{1,32}")


def data_key(domain: int, name: str, kind: RosType) -> str:
    """Return the key of topic or service `name` (resolved: `/user1/pointing_ray`) in `domain`."""
    return f"{domain}/{name[1:]}/{kind.dds_name}/{kind.hash}"


def resolved(name: str) -> str:
    """Return `name`, of a node, topic or service.

    Raises:
        ValueError: If it is not resolved (`/user1/pointing_ray`); its key would mean something else.
    """
    if not NAME.fullmatch(name):
        raise ValueError(
            f"{name!r} is not a full ROS name: chunks of letters, digits and underscores, each after a slash "
            "and beginning with no digit, such as /user1/pointing_ray"
        )
    return name


def dds_type(text: str, type_hash: str) -> RosType:
    """Return the type that middlewares write as `text` (`std_msgs::msg::dds_::Bool_`).

    Raises:
        ValueError: If it, or the hash, is not written that way.
    """
    match = DDS_TYPE.fullmatch(text)
    if match is None or not HASH.fullmatch(type_hash):
        raise ValueError(f"{text!r} with the hash {type_hash!r} is not a type as DDS writes it")
    return RosType(name="/".join(match.groups()), hash=type_hash)


@dataclass(frozen=True, kw_only=True)
class NodeToken:
    """Token of a node."""

    domain: int
    session: str
    """Zenoh's id of it: up to 32 hexadecimal digits."""
    node_id: str
    """Number of the entity in its session; rmw_zenoh counts nodes and endpoints alike."""
    node: str
    """Its full name: `/user1/belt`."""
    enclave: str = ENCLAVE

    @property
    def text(self) -> str:
        """Return the token."""
        return self._chunks(self.node_id, NODE)

    def _chunks(self, entity_id: str, code: str) -> str:
        namespace, _, name = self.node.rpartition("/")
        ids = f"{PRESENCE}/{self.domain}/{self.session}/{self.node_id}/{entity_id}"
        place = f"{mangled(self.enclave)}/{mangled(namespace)}/{name}"
        return f"{ids}/{code}/{place}"


@dataclass(frozen=True, kw_only=True)
class EndpointToken(NodeToken):
    """Token of an endpoint."""

    endpoint_id: str
    kind: EndpointKind
    name: str
    """Name of the topic or service, resolved."""
    type: RosType
    qos: Qos

    @property
    def text(self) -> str:
        """Return the token."""
        node = self._chunks(self.endpoint_id, CODES[self.kind])
        name = mangled(self.name)
        kind = f"{self.type.dds_name}/{self.type.hash}"
        return f"{node}/{name}/{kind}/{qos_text(self.qos)}"


def parsed(text: str) -> NodeToken | EndpointToken:
    """Return a parsed foreign token; chunks after the thirteenth are ignored.

    The text of the result may differ from `text`: hash `text` for the gid of a foreign endpoint.

    Raises:
        ValueError: If it is no such token.
    """
    chunks: list[str] = []
    if len(text) <= MAX_CHARACTERS:
        chunks = text.split("/", ENDPOINT_CHUNKS)
    has_chunks = len(chunks) >= NODE_CHUNKS and all(chunks)
    if not has_chunks or chunks[0] != PRESENCE:
        raise ValueError(f"{text[:100]!r} is not a token of a ROS node")

    # The node, which is in both kinds of tokens
    _, domain, session, node_id, entity_id = chunks[:5]
    code, enclave, namespace, name = chunks[5:NODE_CHUNKS]
    if not SESSION.fullmatch(session) or not DIGITS.fullmatch(domain):
        raise ValueError(f"{text[:100]!r} has a domain or session that is none")
    parent = unmangled(namespace).rstrip("/")
    node = resolved(f"{parent}/{name}")
    own = NodeToken(
        domain=int(domain), session=session, node_id=node_id, node=node, enclave=unmangled(enclave)
    )
    if code == NODE:
        return own

    # Its endpoint
    if code not in KINDS or len(chunks) < ENDPOINT_CHUNKS:
        raise ValueError(f"{text[:100]!r} is neither of a node nor of an endpoint")
    topic, dds_name, type_hash, qos = chunks[NODE_CHUNKS:ENDPOINT_CHUNKS]
    endpoint_name = resolved(unmangled(topic))
    return EndpointToken(
        **vars(own),
        endpoint_id=entity_id,
        kind=KINDS[code],
        name=endpoint_name,
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
    """Return the 16 bytes that identify the endpoint with this token: its XXH3, little endian."""
    digest = xxhash.xxh3_128_intdigest(token.encode())
    return digest.to_bytes(16, "little")
